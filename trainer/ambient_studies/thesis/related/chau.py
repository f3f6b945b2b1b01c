"""Chau 2019: the air's temperature is a straight line of an idle phone's battery temperature.

Given: an idle phone's battery temperature is stable and goes with the air's; one linear regression for the phone in a
pocket and another for the phone out of it, as the body warms the first; laboratory tests.

Filled in: ordinary least squares. "Idle" is read from the logged drives (at most 5 % CPU load, not charging), "stable"
as idle for five minutes and less than 0.5 K away from five minutes before, since a phone that was busy still cools.
This phone was never logged in a pocket, so there is only the line out of it; the other one is the same regression,
``fit`` given traces from a pocket. The line is applied whatever the phone does.

Source: N. H. Chau, "Estimation of air temperature using smartphones in different contexts", Journal of Information and
Telecommunication 3(4), 494-507, 2019 (its abstract).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_studies.thesis.related._samples import Related, training_samples
from ambient_trainer.data import Array, Trace

SENSORS = ("battery_degC",)
DRIVES = ("cpu_load_frac", "charging_on")

_IDLE_LOAD_FRAC = 0.05
_STABLE_K = 0.5
_STABLE_FOR_S = 300.0


@dataclass(frozen=True)
class Line:
    """ambient = slope * battery + offset; ``offset_degC`` in degC."""

    slope: float
    offset_degC: float

    def ambient_degC(self, time_s: Array, rows: Array) -> Array:
        """The estimate, shape (n,), from the battery's temperature (1, n)."""
        return self.slope * rows[0] + self.offset_degC


def train(*traces: Trace) -> Line:
    """Least-squares line through the idle, stable samples; :class:`Refused` where they are missing or at one value."""
    found = [_idle(trace) for trace in traces]
    battery, ambient = np.concatenate(found, axis=1)
    if len(battery) < 2 or np.ptp(battery) == 0:
        problem = f"{len(battery)} samples of an idle phone with a stable battery, at fewer than two temperatures"
        source = ", ".join(trace.path for trace in traces)
        raise refuse(source, "", problem, "log the idle phone at several ambient temperatures")
    slope, offset = np.polyfit(battery, ambient, 1)
    return Line(float(slope), float(offset))


def _idle(trace: Trace) -> Array:
    """Temperatures of battery and air (2, n) at the samples to fit."""
    samples = training_samples(trace, (*SENSORS, *DRIVES))
    battery, load, charging = samples.rows
    idle = (load <= _IDLE_LOAD_FRAC) & (charging == 0)
    chosen = stable(samples.time_s, battery, idle) & ~np.isnan(samples.ambient_degC)
    return np.vstack([battery[chosen], samples.ambient_degC[chosen]])


def stable(time_s: Array, battery_degC: Array, idle: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the phone has idled for five minutes, and its battery is about as warm as before them; shape (n,)."""
    before = np.searchsorted(time_s, time_s - _STABLE_FOR_S, side="right") - 1
    moved = np.abs(battery_degC - battery_degC[np.maximum(before, 0)])
    last_busy_s = np.maximum.accumulate(np.where(idle, -np.inf, time_s))
    return np.asarray((before >= 0) & (moved < _STABLE_K) & (time_s - last_busy_s > _STABLE_FOR_S))


METHOD = Related(
    "chau_linear_battery",
    "Chau 2019: a line of the battery temperature, out of a pocket. Given: the regression, the idle phone. Filled in: "
    "when a phone counts as idle",
    SENSORS,
    train,
    ("5", "1"),
)
