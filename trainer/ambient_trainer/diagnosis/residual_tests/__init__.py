"""Tests of a residual: whether it is white, and which signals, rates and changes it correlates with.

All thresholds are the textbook's. Those of what a residual goes along with hold for all subjects, delays and sensors of
a report together, by Sidak and Bonferroni: one report in 20 without an effect is meant to have a false alarm. Of 100
with 100, and 1000, white samples 0 and 1 had one; with an autocorrelation time of 10 samples 4 of 100 with 400, 1 of
100 with 1200; of 100 samples 7 of 100 with 400, 2 of 60 with 1200. It is too often where half is white noise and half
has an autocorrelation time of 100 samples: 7 of 60 with 100, 9 of 60 with 400.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.record import bridged
from ambient_trainer.diagnosis.residual_tests.prewhitening import Largest, correlated, shifted, testable, whitening
from ambient_trainer.diagnosis.residual_tests.whiteness import (
    autocorrelation_test,
    autocorrelation_time_s,
    cumulated_periodogram,
    ljung_box,
)
from ambient_trainer.diagnosis.result import Tested
from ambient_trainer.lti.lag import lagged
from ambient_trainer.report.words import clock, digits, duration

LEVEL = 0.05
"""How often, without any effect, any of the robust tests of a report fails; and any of those for whiteness."""
MOST_SAMPLES = 1200
"""Few enough that some tens of them are as long as a residual's autocorrelation time, or nearly."""
_DELAYS_STEPS = 0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0
_LONGEST_DELAY_FRAC = 0.25
_RATE_STEPS = 5
_ORDER = (
    "cross-correlation", "ambient difference", "ambient difference, curved", "ambient rate", "ambient rate, curved",
    "drift", "change", "change of heat",
)  # fmt: skip
_Compared = tuple[str, str, str, str, Largest]
"""A robust test before its threshold: its name, its subject, what it says where it is significant, and where not."""


def residual_tests(
    time_s: Array,
    residual_degC: Array,
    heat: Array,
    sensors: Sequence[str],
    signals: Mapping[str, Array],
    ambient_degC: Array,
    measured_degC: Array,
) -> tuple[Tested, ...]:
    """Every test of ``residual_degC`` (sensors, N), measured minus simulated, and of the ``heat`` that explains it.

    ``time_s`` (N,) is uniform; ``signals`` and ``ambient_degC`` are (N,), ``measured_degC`` is (sensors, N). NaN is a
    missing value. A sensor of too few samples, or one that never changes, and a signal that never does have no test.
    """
    time_s = _coarse(time_s)
    step_s = float(np.ptp(time_s[:2]))
    logged, air = {name: bridged(_coarse(row)) for name, row in signals.items()}, _coarse(ambient_degC)
    residuals = {row: each for row, every in enumerate(residual_degC) if testable(each := _coarse(every))}
    white: list[Tested] = []
    found: list[_Compared] = []
    for row, series in residuals.items():
        given, alpha = (series, sensors[row]), LEVEL / (2 * len(residuals))
        white += [ljung_box(*given, alpha), cumulated_periodogram(*given, step_s, alpha)]
        white.append(autocorrelation_test(*given, step_s))
        simulated = bridged(_coarse(measured_degC[row] - residual_degC[row]))
        found += _along(*given, logged, air, simulated, step_s)
        found += _changes(*given, _coarse(heat[row]), time_s)
    found.sort(key=lambda each: _ORDER.index(each[0]))
    alpha = 1 - (1 - LEVEL) ** (1 / max(1, len(found)))
    return (*white, *(Tested.of(*each[:4], each[4].t, each[4].threshold(alpha)) for each in found))


def correlation_s(time_s: Array, residual_degC: Array) -> float:
    """The autocorrelation time of one sensor's residual (N,); NaN where it has no tests."""
    time_s, series = _coarse(time_s), _coarse(residual_degC)
    return autocorrelation_time_s(series, float(time_s[1] - time_s[0])) if testable(series) else math.nan


def _coarse(values: Array) -> Array:
    """The means of ``values`` (N,) over as many samples each as leave at most :data:`MOST_SAMPLES`; NaN where none is
    known."""
    every = -(-len(values) // MOST_SAMPLES)
    return pd.Series(values).groupby(np.arange(len(values)) // every).mean().to_numpy()


def _along(
    series: Array, sensor: str, logged: Mapping[str, Array], air: Array, simulated: Array, step_s: float
) -> Iterator[_Compared]:
    """What a residual goes along with; the difference to the ambient is the simulated node's: the measured one's noise
    is also in the residual."""
    whiten = whitening(series)

    def tested(test: str, what: str, hint: str, course: Array, *given: Array) -> Iterator[_Compared]:
        """Whether it follows ``course`` (n,), beside what is ``given``, and what that would mean."""
        if np.ptp(course[np.isfinite(series)]) > 0:
            (responses, delays), others = _delayed(course), [_delayed(each)[0] for each in given]
            largest, best, size = correlated(series, whiten, responses, *others)
            delay = f"with a delay of about {duration(delays[best] * step_s)}" if delays[best] else "at once"
            if_significant = f"the residual follows {what} {delay}, by {digits(size, 2)} degC over its range{hint}"
            if_not = f"the residual does not follow {what} more than chance would"
            yield test, f"{sensor}, {what}" if what in logged else sensor, if_significant, if_not, largest

    for name, row in logged.items():
        yield from tested("cross-correlation", name, "", row)
    if not np.isfinite(air).any():
        return
    air = bridged(air)
    changes = np.gradient(uniform_filter1d(air, _RATE_STEPS, mode="nearest"))
    for test, course, what, straight, curved in (
        ("ambient difference", simulated - air, "the node's difference to the ambient",
         ": a resistance may be wrong or have changed", ": the loss may not be proportional to the difference"),
        ("ambient rate", changes, "the ambient's rate of change",
         ": a mass or a delay may be missing", ": what is missing acts on fast changes only"),
    ):  # fmt: skip
        if np.ptp(course) > 1e-9:
            yield from tested(test, what, straight, course)
            yield from tested(f"{test}, curved", f"the square of {what}", curved, (course - course.mean()) ** 2, course)


def _delayed(course: Array) -> tuple[Array, list[float]]:
    """What bodies that follow ``course`` (n,) with longer and longer delays make of it, (d, n), and these in steps."""
    delays = [each for each in _DELAYS_STEPS if each <= _LONGEST_DELAY_FRAC * len(course)]
    return np.stack([course, *(lagged(course, each, 1.0) for each in delays[1:])]), delays


def _changes(series: Array, sensor: str, heat: Array, time_s: Array) -> Iterator[_Compared]:
    course, known = time_s - time_s[0], np.isfinite(series)
    # a drift would pass for autocorrelation
    straight = np.polyval(np.polyfit(course[known], series[known], 1), course)
    largest, _, size = correlated(series, whitening(series - straight), course[None])
    if_significant = f"the residual drifts by {digits(size, 2)} degC over {duration(course[-1])}"
    yield "drift", sensor, if_significant, "the residual does not drift more than its autocorrelation explains", largest
    changing = [("change", series, "the residual", " degC")]
    if testable(heat):
        changing.append(("change of heat", heat, "the heat that explains the residual", ""))
    for test, each, what, unit in changing:
        largest, turns = shifted(each)
        first, other, *last = (np.nanmean(piece) for piece in np.split(each, [turn + 1 for turn in turns]))
        height = other - np.mean([first, *last])
        how = f"{'rises' if height > 0 else 'falls'}{f' by {digits(abs(height), 2)}{unit}' if unit else ''}"
        times = f"{' and comes back,' if last else ''} at about {' and '.join(clock(time_s[turn]) for turn in turns)}"
        yield test, sensor, f"{what} {how}{times}", f"{what} keeps its level", largest
