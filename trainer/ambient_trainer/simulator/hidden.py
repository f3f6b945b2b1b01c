"""A hidden effect is data, a :class:`Hidden`; its cause is an :class:`Effect`, one file of ``effects``.

The file holds what its physics are, where and how large it is drawn, how its size is written, and its true magnitude in
the terms of a diagnosis. Effects come and go within a minute or so, bend, flicker and skew, as real ones do: none of
them is a candidate's own equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.simulator.additions import TERMS, Added
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.heat import HeatBalance
from ambient_trainer.simulator.run import Driven

Figure = tuple[float, str, dict[str, tuple[float, str]]]
"""Magnitude, its unit, further figures by name."""

SOURCE = "hidden effect"
PLUGINS = "ambient_trainer.simulator.effects"
SLEW_S = 60.0
"""From an onset on, until an effect is there in full."""
_THERE = 0.5


@dataclass(frozen=True)
class Hidden:
    """One effect; its ``cause`` names what says what the others mean.

    ``location`` is a node, ``a-b`` of two, a surface or a sensor of the device, None for all of them; ``signal`` is the
    trace column that drives it, ``body`` what makes contact. ``onset_s`` and ``end_s`` are of the recording's time:
    from 0 is since ever, to None to the end. ``size`` is in the effect's unit.
    """

    cause: str
    location: str | None = None
    signal: str | None = None
    onset_s: float = 0.0
    end_s: float | None = None
    size: float | None = None
    body: str | None = None

    @property
    def amount(self) -> float:
        """The size as a number: zero where there is none."""
        return 0.0 if self.size is None else self.size

    def lasting(self, time_s: Array, period_s: float) -> tuple[float, float]:
        """From and to in a run of those samples; what lasts since ever does so before the recording, too."""
        end_s = float(time_s[-1]) + period_s
        start_s = float(time_s[0]) if self.onset_s <= 0.0 else self.onset_s
        return start_s, end_s if self.end_s is None else min(self.end_s, end_s)


@dataclass(frozen=True)
class Acting:
    """One effect where it acts: a device and n samples, from before the recording's 0 s on; signals by column, (n,)."""

    device: Device
    time_s: Array
    period_s: float
    signals: Mapping[str, Array]
    hidden: Hidden
    random: Callable[[], np.random.Generator]
    """Gives the effect's own random numbers, from their beginning."""

    @property
    def effect(self) -> Effect:
        """Its physics."""
        return effects()[self.hidden.cause]

    @property
    def driver(self) -> Array | None:
        """The signal that drives it, shape (n,); None where there is none."""
        return None if self.hidden.signal is None else self.signals[self.hidden.signal]

    @property
    def lasting(self) -> tuple[float, float]:
        """From and to; what lasts since ever does so before the recording, too."""
        return self.hidden.lasting(self.time_s, self.period_s)

    @property
    def lasts(self) -> NDArray[np.bool_]:
        """When an effect that comes and goes at once is there."""
        start_s, end_s = self.lasting
        return (self.time_s >= start_s - 1e-9) & (self.time_s < end_s - 1e-9)

    @property
    def covered(self) -> tuple[str, ...]:
        """The surfaces that the effect is about."""
        return self.device.covered(self.hidden.location)

    def share(self, slew_s: float = SLEW_S) -> Array:
        """How much of an effect is there, 0 to 1: it comes and goes smoothly, or is there since ever."""
        hidden = self.hidden
        came = np.ones_like(self.time_s) if hidden.onset_s <= 0.0 else _smooth((self.time_s - hidden.onset_s) / slew_s)
        gone = 0.0 if hidden.end_s is None else _smooth((self.time_s - hidden.end_s) / slew_s)
        return came * (1.0 - gone)

    def part(self, number: int) -> Added:
        """What effect ``number`` of a run adds to its heat balance; nothing where it is of size zero."""
        return self.effect.added(self, f"effect {number}") if self.hidden.amount else Added()


@dataclass(frozen=True)
class Ran(Acting):
    """One effect in the run that went through it; arrays over all samples, also those before the recording."""

    driven: Driven
    added: Added
    """By the effect alone."""
    all_added: Added
    """By all effects of the run."""
    trace: Trace

    @property
    def there(self) -> NDArray[np.bool_]:
        """Where the recording has the effect in force: with an on/off signal while that is on."""
        there = (self.share() > _THERE) & (self.time_s > -1e-9)
        return there if self.driver is None else there & (self.driver > 0.0)

    @property
    def places(self) -> list[int]:
        """Of the surfaces that the effect is about, in arrays of nodes."""
        return list(map(self.device.index, self.covered))

    def heat(self, added: Added) -> Array:
        """Heat into every node by terms along the run, shape (n, nodes)."""
        balance = HeatBalance([self.driven.run.device])
        heat = np.zeros((len(self.time_s), balance.size))
        for term in added.terms:
            into = TERMS[term.kind](self.driven.nodes_degC, self.driven.run.air_degC, balance)
            heat += term.course[:, None] * term.pattern * into
        return heat

    def losses(self) -> tuple[Array, Array]:
        """What the affected nodes lose to the ambient with the effect and without it, shape (n, affected)."""
        own = HeatBalance([self.driven.run.device]).lost(self.driven.nodes_degC, self.driven.run.air_degC)
        outside = Added(tuple(term for term in self.all_added.terms if term.kind not in ("steady", "ohmic")))
        with_it = own - self.heat(outside)
        return with_it[:, self.places], (with_it + self.heat(self.added))[:, self.places]


class Effect:
    """A cause that can be hidden: one file of ``effects`` overrides what differs and names an instance ``EFFECT``."""

    rank = 100
    """The order in which causes are drawn; new ones come last, by their names."""
    unit = ""
    low, high = 0.0, 9.0
    """What a size lies within, in ``unit``."""
    meaning = "size"
    """What the size is, for messages."""
    typical = 0.1
    """The size at scale 1 where the device does not state one."""
    signals: tuple[str, ...] = ()
    """Columns that may drive it."""
    bodies: tuple[str, ...] = ()
    at: Literal["nodes", "surfaces", "sensors"] = "nodes"
    """Of what of the device its place is one."""
    everywhere = False
    """Whether no place, that is all of it, is allowed too."""
    since_ever = False
    """Whether one that is drawn is there from before the recording, to its end."""
    for_good = False
    """Whether one that is drawn lasts to the end."""
    needs_size = True
    in_reference = False
    """Whether it changes the reference instead of the sensors."""

    def places(self, device: Device) -> tuple[str, ...]:
        """Where it may be."""
        return tuple(getattr(device, self.at))

    def drawn_size(self, typical: float, sign: float, chance: float, signal: str | None) -> float:
        """A size from the typical one, a random sign, and a random number from 0 to 1."""
        return typical * sign if self.low < 0.0 else typical

    def added(self, acting: Acting, name: str) -> Added:
        """What it adds to the heat balance; ``name`` distinguishes its bodies from another effect's."""
        return Added()

    def felt(self, acting: Acting, felt_degC: Array) -> Array:
        """What its sensor feels, shape (n,)."""
        return felt_degC

    def read(self, acting: Acting, reading_degC: Array, step_degC: float) -> Array:
        """What its sensor reports, shape (n,)."""
        return reading_degC

    def air(self, acting: Acting, air_degC: Array) -> Array:
        """The air that the reference records, shape (n,)."""
        return air_degC

    def magnitude(self, ran: Ran) -> Figure:
        """The true magnitude of what went through a run, where it was ever in force."""
        return ran.hidden.amount, self.unit or "1", {}


def effects() -> dict[str, Effect]:
    """Every effect by its cause, in the order in which causes are drawn."""
    known: dict[str, Effect] = {name.replace("-", "_"): plugin(PLUGINS, name).EFFECT for name in plugin_names(PLUGINS)}
    return dict(sorted(known.items(), key=lambda item: item[1].rank))


def faults(hidden: Hidden, device: Device) -> Iterator[Fault]:
    """What is wrong with an effect in a device, whatever run it is hidden in."""
    effect = effects().get(hidden.cause)
    if effect is None:
        yield Fault("cause", f"{hidden.cause!r} is none", f"take one of {', '.join(effects())}")
        return
    places = effect.places(device)
    if hidden.location not in (*places, *((None,) if effect.everywhere else ())):
        problem = "missing" if hidden.location is None else f"it cannot be at {hidden.location!r}"
        hint = f"take one of {', '.join((*(('all',) if effect.everywhere else ()), *places))}"
        if any("-" in place for place in places):
            hint = f"take two different ones, with a hyphen between, of {', '.join(device.nodes)}"
        yield Fault("location", problem, hint)
    if hidden.signal not in (None, *effect.signals):
        hint = f"take one of {', '.join(effect.signals)}, or none" if effect.signals else "leave it out"
        yield Fault("signal", f"{hidden.signal!r} cannot drive {hidden.cause}", hint)
    if hidden.body not in (None, *effect.bodies):
        hint = f"take one of {', '.join(effect.bodies)}" if effect.bodies else f"{hidden.cause} has none"
        yield Fault("body", f"it cannot be {hidden.body!r}", hint)
    if hidden.size is None and effect.needs_size:
        yield Fault("size", "missing", f"give the {effect.meaning}")
    if hidden.size is not None and not effect.low <= hidden.size <= effect.high:
        hint = f"take {effect.low:g} to {effect.high:g} {effect.unit}".rstrip() + f": {effect.meaning}"
        yield Fault("size", f"{hidden.size:g} is out of range", hint)
    if not (math.isfinite(hidden.onset_s) and hidden.onset_s >= 0.0):
        yield Fault("from", f"{hidden.onset_s:g} s is no time in a recording", "take 0 or later")
    if hidden.end_s is not None and not (math.isfinite(hidden.end_s) and hidden.end_s > hidden.onset_s):
        problem = f"{hidden.end_s:g} s does not come after {hidden.onset_s:g} s"
        yield Fault("to", problem, "take a later time, or none")


def checked(hidden: Hidden, device: Device) -> Hidden:
    """``hidden`` itself; raises :class:`Refused` with every fault."""
    if found := list(faults(hidden, device)):
        raise Refused(SOURCE, found)
    return hidden


def run_faults(hidden: Sequence[Hidden], duration_s: float) -> Iterator[Fault]:
    """What is wrong with effects that are hidden together in a run of ``duration_s``."""
    windows: dict[str, tuple[float, float | None]] = {}
    for index, effect in enumerate(hidden):
        where = f"effect {index + 1} ({effect.cause})"
        outside = outside_faults(effect.onset_s, effect.end_s, duration_s)
        yield from (Fault(f"{where}, {fault.place}", fault.problem, fault.hint) for fault in outside)
        if effect.signal is not None:
            window = (effect.onset_s, effect.end_s)
            if windows.setdefault(effect.signal, window) != window:
                problem = f"{effect.signal} would be on at other times for another effect"
                yield Fault(f"{where}, signal", problem, "give both the same times, or another signal")


def outside_faults(onset_s: float | None, end_s: float | None, duration_s: float) -> Iterator[Fault]:
    """Which of the times, None for none, lie outside a run of ``duration_s``."""
    hint = f"it lasts from 0 to {duration_s:g} s"
    if onset_s is not None and onset_s >= duration_s:
        yield Fault("from", f"{onset_s:g} s is outside the run", hint)
    if end_s is not None and end_s > duration_s:
        yield Fault("to", f"{end_s:g} s is outside the run", hint)


def slope(values: Array, on: Array) -> float:
    """Least squares through the origin."""
    return float(values @ on / (on @ on)) if on.any() else 0.0


def _smooth(way: Array) -> Array:
    """0 up to 0, 1 from 1 on."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(way, 0.0, 1.0))
