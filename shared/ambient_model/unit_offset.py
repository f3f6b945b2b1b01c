"""A unit's own offset: a scalar Kalman filter that weak references of the ambient update.

    b[k+1] = phi b[k] + w,   phi = exp(-T / forgotten_s),  w ~ N(0, (1 - phi^2) std^2)
    y[k] = reference - estimate = b[k] + v,   v ~ N(0, R),  R = sigma^2 + variance of the estimate but for b's

b is a stationary Ornstein-Uhlenbeck process: without references it returns to 0 +- std. A reference is refused where
|y - b| > 3 sqrt(P + min(R, (2 degC)^2)): one that claims a large sigma is not accepted further off for that. b stays
within the bound whatever is accepted. Only the offset is estimated, not the gain. It knows no clock.

Where the model file holds ``offset_gains``, sensors' own constant errors are taken off the readings before all else.
They are learnt when a reference is accepted, from how far each reading differs from what the others make expect; what
the reference says has no part in it. The offset b is what they leave.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from ambient_model.model import SCORES, Matrix, ReadingModel
from ambient_model.recursion import dot
from ambient_model.tracking import DEGRADED, TRACKING, Estimate, Readings
from ambient_model.validation import SENTINELS_DEGC

LEARNING = (TRACKING, DEGRADED)
"""Statuses in which a reference counts. On another unit than the trained one, whose sensors are off by tenths, two
thirds of the samples at rest are degraded; the interval is wider then, and the reference has less weight."""

_GATE_SIGMAS = 3.0
_MOST_GATED_DEGC2 = 4.0
_NEW = tuple.__new__  # a named tuple's own costs a call more
_MOST_SEEN = 28
"""Sensors' errors are forgotten as slowly as the offset where one reference counts a day."""


class OffsetPrior(NamedTuple):
    """What is known of the offset before any reference."""

    std_degC: float = 0.5
    """From unit to unit. 0.39 degC is the median RMSE of a model on fifty simulated units, 0.20 on its own: a median
    offset of 0.34 degC, which is 0.67 standard deviations."""
    bound_degC: float = 1.0
    forgotten_s: float = 28 * 86400.0


class OffsetState(NamedTuple):
    """Mean and variance of the offset at one time."""

    offset_degC: float
    variance_degC2: float
    time_s: float


def initial(prior: OffsetPrior, time_s: float = 0.0) -> OffsetState:
    """The state before any reference."""
    return OffsetState(0.0, prior.std_degC**2, time_s)


def predicted(prior: OffsetPrior, state: OffsetState, time_s: float) -> OffsetState:
    """The state at ``time_s``; a clock that goes back forgets nothing."""
    phi = math.exp(-max(0.0, time_s - state.time_s) / prior.forgotten_s)
    variance = phi * phi * state.variance_degC2 + (1 - phi * phi) * prior.std_degC**2
    return OffsetState(phi * state.offset_degC, variance, time_s)


def updated(prior: OffsetPrior, state: OffsetState, y_degC: float, R_degC2: float) -> OffsetState | None:
    """The state after ``y_degC`` = reference - estimate, whose variance is ``R_degC2``; None where it is refused."""
    b, P, time_s = state
    if not abs(y_degC - b) <= _GATE_SIGMAS * math.sqrt(P + min(R_degC2, _MOST_GATED_DEGC2)):
        return None
    gain = P / (P + R_degC2)
    b += gain * (y_degC - b)
    return OffsetState(min(max(b, -prior.bound_degC), prior.bound_degC), (1 - gain) * P, time_s)


def learning_sensors(prior: OffsetPrior, model: ReadingModel) -> OffsetPrior:
    """The prior where sensors' own errors are learnt: no wider than what they make of the estimate."""
    return prior._replace(std_degC=min(prior.std_degC, model.offset_std_degC or math.inf))


class SensorOffsets(NamedTuple):
    """Each sensor's own constant error: the mean of what was seen so many times, of late."""

    degC: tuple[float, ...]
    seen: int = 0


def sensors_updated(
    prior: OffsetPrior, sensors: SensorOffsets, gains: Matrix, slow_degC: Sequence[float]
) -> SensorOffsets:
    """After the slow differences ``slow_degC`` that readings as they come would have, of which ``gains`` make offsets.

    Where they make one beyond the bound, heat makes the difference, and nothing is learnt.
    """
    found = [dot(row, slow_degC) for row in gains]
    if not all([abs(each) <= prior.bound_degC for each in found]):
        return sensors
    seen = min(sensors.seen + 1, _MOST_SEEN)
    return SensorOffsets(tuple([mean + (each - mean) / seen for mean, each in zip(sensors.degC, found)]), seen)


def corrected(readings: Readings, offsets_degC: Sequence[float]) -> list[float | None]:
    """The readings without the sensors' own errors; what a sensor reports where it has no value is left as it is."""
    return [
        value if value is None or value in SENTINELS_DEGC else value - offset
        for value, offset in zip(readings, offsets_degC)
    ]


def estimate_variance_degC2(estimate: Estimate, level_percent: int, offset_degC2: float = 0.0) -> float:
    """The variance that the published interval of ``level_percent`` stands for, beside the offset's.

    While it is degraded, the interval holds how far the readings differ from what training makes expect. Another unit's
    offset differs so too: its variance before any reference, ``offset_degC2``, is the filter's, not the estimate's.
    """
    if estimate.low_degC is None or estimate.high_degC is None:
        return math.inf
    variance = ((estimate.high_degC - estimate.low_degC) / 2 / SCORES[level_percent]) ** 2
    return max(variance - offset_degC2, 0.0) if estimate.status == DEGRADED else variance


def shifted(estimate: Estimate, offset_degC: float) -> Estimate:
    """The estimate and both ends of its interval, moved by the offset."""
    ambient, low, high, status, used = estimate
    if ambient is None or low is None or high is None:
        return estimate
    return _NEW(Estimate, (ambient + offset_degC, low + offset_degC, high + offset_degC, status, used))
