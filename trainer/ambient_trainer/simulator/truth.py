"""The truth about a hidden effect, in the terms of a diagnosis; computed from the physics that ran, never logged."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.hidden import Ran


@dataclass(frozen=True)
class Truth:
    """What a diagnosis should report of one effect.

    ``location`` is the simulated node, ``a-b``, the sensor, or None; ``sensor_location`` is the same by the names of
    the device's sensors, which circuits call their nodes, None where no sensor is there. ``onset_s`` is None for since
    ever, ``end_s`` for to the end. ``magnitude`` is in ``unit``; ``others`` are further figures, (value, unit).
    """

    cause: str
    location: str | None
    sensor_location: str | None
    signal: str | None
    onset_s: float | None
    end_s: float | None
    magnitude: float
    unit: str
    others: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    size_degC: float | None = None
    """RMS over the time it is there of what it changes, in the trace's worst column; None where that was not run."""
    worst: str | None = None
    """That column: a sensor, or the reference for a clock."""

    def as_data(self) -> dict[str, object]:
        """For a JSON file."""
        return asdict(self)


def truth(ran: Ran) -> Truth:
    """The truth about one effect; zero where it was never in force."""
    hidden, there = ran.hidden, ran.there
    magnitude, unit, others = ran.effect.magnitude(ran) if there.any() else (0.0, "", {})
    return Truth(
        hidden.cause,
        hidden.location,
        _by_sensors(ran.setting.device, hidden.location),
        hidden.signal,
        _onset(ran),
        None if hidden.end_s is None or hidden.end_s >= ran.setting.time_s[-1] else hidden.end_s,
        float(magnitude),
        unit,
        {name: (float(value), of) for name, (value, of) in others.items()},
    )


def size_degC(effect: Trace, clean: Trace, ran: Ran) -> tuple[float, str]:
    """RMS of what an effect changes while it is there, in the worst column, and that column.

    ``clean`` is the same run, with the same noise, without it. The column is a sensor, or the reference where the
    effect changes that alone.
    """
    there = ran.there[ran.driven.run.unrecorded :]
    names = [REFERENCE] if ran.effect.in_reference else _sensors(clean)
    if not there.any():
        return 0.0, names[0]
    rms = {name: float(np.sqrt(np.mean((effect.columns[name] - clean.columns[name])[there] ** 2))) for name in names}
    worst = max(rms, key=rms.__getitem__)
    return rms[worst], worst


def _sensors(trace: Trace) -> list[str]:
    return [name for name in trace.columns if name.endswith("_degC") and name != REFERENCE]


def _by_sensors(device: Device, location: str | None) -> str | None:
    if location is None:
        return None
    named = [device.sensor_of(part) for part in location.split("-")]
    return None if None in named else "-".join(str(each) for each in named)


def _onset(ran: Ran) -> float | None:
    if ran.hidden.signal and ran.there.any():
        return float(ran.setting.time_s[int(np.argmax(ran.there))])
    return ran.hidden.onset_s or None
