"""A hidden effect is data: a cause, a place, a signal, a time and a size; what no physics here can do is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

from ambient_model.faults import Fault, Refused
from ambient_trainer.simulator.constants import NODES, SURFACE_M2
from ambient_trainer.simulator.zones import THESIS_ZONES

SOURCE = "hidden effect"
BODIES = ("hand", "pocket", "table")
_SURFACES = tuple(SURFACE_M2)
_PAIRS = tuple("-".join(pair) for pair in permutations(NODES, 2))


@dataclass(frozen=True)
class Kind:
    """What a cause of the contract may be hidden with; a size lies from ``low`` to ``high``, in ``unit``."""

    unit: str
    low: float
    high: float
    size: str
    """What the size means."""
    places: tuple[str, ...]
    everywhere: bool = False
    """Whether no place, that is all of it, is allowed too."""
    signals: tuple[str, ...] = ()


KINDS = {
    "heat_source": Kind(
        *("W", 0.0, 10.0, "heat while on; at 800 W/m2 of irradiance, or 1 A of current"),
        *(NODES, False, ("radio_on", "charger_on", "irradiance_W_m2", "accessory_current_A")),
    ),
    "ambient_coupling": Kind(
        *(
            "",
            -0.9,
            9.0,
            "relative change of the convective resistance at 10 K: a case is +, a fan -; at 2 m/s of wind",
        ),
        *(_SURFACES, True, ("fan_on", "case_on", "wind_m_s")),
    ),
    "contact": Kind("W/K", 0.0, 2.0, "conductance between body and phone", _SURFACES, True),
    "convection_law": Kind("", 0.0, 9.0, "loss at 15 K by a draught, in the convective loss there", _SURFACES, True),
    "thermal_mass": Kind("J/K", 0.0, 2000.0, "capacitance of what is attached", NODES),
    "path": Kind("W/K", 0.0, 0.5, "conductance of the strap", _PAIRS),
    "sensor_bias": Kind("degC", -50.0, 50.0, "what is added to the reading", THESIS_ZONES),
    "sensor_gain": Kind("", -0.9, 9.0, "relative error of the slope", THESIS_ZONES),
    "sensor_lag": Kind("s", 0.0, 3600.0, "mean delay", THESIS_ZONES),
    "sensor_stuck": Kind("degC", -60.0, 150.0, "what is reported; none given: what it read then", THESIS_ZONES),
    "sensor_drift": Kind("K/h", -60.0, 60.0, "rate", THESIS_ZONES),
    "clock_offset": Kind("s", -3600.0, 3600.0, "reference's clock less the device's", (), True),
}
"""What can be hidden, by cause."""


@dataclass(frozen=True)
class Hidden:
    """One effect; raises :class:`Refused` with every fault.

    ``location`` is a simulated node, ``a-b`` of two, a sensor of the thesis, or None for all of them; ``back`` stands
    for the rear shell, back and frame, where it is about a surface. ``signal`` is the trace column that drives it.
    It lasts from ``onset_s`` to ``end_s`` in the recording's time; from 0: since ever, to None: to the end.
    ``size`` is in ``KINDS[cause].unit``; None only for a sensor that sticks at what it reads. ``body`` is what makes
    contact: hand, pocket or table.
    """

    cause: str
    location: str | None = None
    signal: str | None = None
    onset_s: float = 0.0
    end_s: float | None = None
    size: float | None = None
    body: str | None = None

    def __post_init__(self) -> None:
        found = faults(self)
        if found:
            raise Refused(SOURCE, found)

    @property
    def amount(self) -> float:
        """The size as a number: zero where there is none."""
        return 0.0 if self.size is None else self.size


def faults(hidden: Hidden) -> list[Fault]:
    """What is wrong with an effect, whatever run it is hidden in."""
    kind = KINDS.get(hidden.cause)
    if kind is None:
        return [Fault("cause", f"{hidden.cause!r} is none", f"take one of {', '.join(KINDS)}")]
    return [
        *_place_faults(hidden.location, kind),
        *_signal_faults(hidden, kind),
        *_size_faults(hidden, kind),
        *_time_faults(hidden),
    ]


def run_faults(effects: Sequence[Hidden], duration_s: float) -> list[Fault]:
    """What is wrong with effects that are hidden together in a run of ``duration_s``."""
    found = []
    windows: dict[str, tuple[float, float | None]] = {}
    for index, effect in enumerate(effects):
        where = f"effect {index + 1} ({effect.cause})"
        outside = outside_faults(effect.onset_s, effect.end_s, duration_s)
        found += [Fault(f"{where}, {fault.place}", fault.problem, fault.hint) for fault in outside]
        if effect.signal is not None:
            window = (effect.onset_s, effect.end_s)
            if windows.setdefault(effect.signal, window) != window:
                problem = f"{effect.signal} would be on at other times for another effect"
                found.append(Fault(f"{where}, signal", problem, "give both the same times, or another signal"))
    return found


def outside_faults(onset_s: float | None, end_s: float | None, duration_s: float) -> list[Fault]:
    """Which of the times, None for none, lie outside a run of ``duration_s``."""
    return [
        Fault(name, f"{time_s:g} s is outside the run", f"it lasts from 0 to {duration_s:g} s")
        for name, time_s, outside in (
            ("from", onset_s, (onset_s or 0.0) >= duration_s),
            ("to", end_s, (end_s or 0.0) > duration_s),
        )
        if outside and time_s is not None
    ]


def _place_faults(location: str | None, kind: Kind) -> list[Fault]:
    if location is None:
        if kind.everywhere:
            return []
        return [Fault("location", "missing", f"take one of {_listed(kind.places)}")]
    if location in kind.places:
        return []
    allowed = (("all",) if kind.everywhere else ()) + kind.places
    return [Fault("location", f"it cannot be at {location!r}", f"take one of {_listed(allowed)}")]


def _signal_faults(hidden: Hidden, kind: Kind) -> list[Fault]:
    found = []
    if hidden.signal is not None and hidden.signal not in kind.signals:
        mend = f"take one of {', '.join(kind.signals)}, or none" if kind.signals else "leave it out"
        found.append(Fault("signal", f"{hidden.signal!r} cannot drive {hidden.cause}", mend))
    if hidden.body is not None and (hidden.cause != "contact" or hidden.body not in BODIES):
        mend = f"take one of {', '.join(BODIES)}" if hidden.cause == "contact" else "only contact has one"
        found.append(Fault("body", f"it cannot be {hidden.body!r}", mend))
    return found


def _size_faults(hidden: Hidden, kind: Kind) -> list[Fault]:
    if hidden.size is None:
        return [] if hidden.cause == "sensor_stuck" else [Fault("size", "missing", f"give the {kind.size}")]
    if not kind.low <= hidden.size <= kind.high:
        unit = f" {kind.unit}" if kind.unit else ""
        mend = f"take {kind.low:g} to {kind.high:g}{unit}: {kind.size}"
        return [Fault("size", f"{hidden.size:g} is out of range", mend)]
    return []


def _time_faults(hidden: Hidden) -> list[Fault]:
    found = []
    if not (math.isfinite(hidden.onset_s) and hidden.onset_s >= 0.0):
        found.append(Fault("from", f"{hidden.onset_s:g} s is no time in a recording", "take 0 or later"))
    if hidden.end_s is not None and not (math.isfinite(hidden.end_s) and hidden.end_s > hidden.onset_s):
        problem = f"{hidden.end_s:g} s does not come after {hidden.onset_s:g} s"
        found.append(Fault("to", problem, "take a later time, or none"))
    return found


def _listed(names: Sequence[str]) -> str:
    pairs = any("-" in name for name in names)
    return f"two different ones, with a hyphen between, of {', '.join(NODES)}" if pairs else ", ".join(names)
