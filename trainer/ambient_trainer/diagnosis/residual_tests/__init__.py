"""Tests of a residual, in the order in which one reads them: is it white noise, and what does it go along with.

The thresholds of the tests for whiteness are the textbook's. An autocorrelated residual exceeds all others by chance:
theirs come from residuals simulated without an effect, with autoregressions drawn from those that the residual leaves
probable. One report in 20 without an effect is meant to have a false alarm: of 60 with 100 white samples 2 had one; of
samples half white noise and half with an autocorrelation time of 100, 1 of 40 with 400 had one, 7 of 60 with 100.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.record import bridged
from ambient_trainer.diagnosis.residual_tests.dependence import Calibrated, curved, delayed, levels, rate, thresholds
from ambient_trainer.diagnosis.residual_tests.memory import remembered
from ambient_trainer.diagnosis.residual_tests.whiteness import (
    autocorrelation_time_s,
    cumulated_periodogram,
    ljung_box,
    memory,
)
from ambient_trainer.diagnosis.result import Tested
from ambient_trainer.diagnosis.words import clock, digits, duration

LEVEL = 0.05
"""How often, without any effect, any of the robust tests of a report fails; and any of those for whiteness."""
MOST_SAMPLES = 1200
"""Few enough that a residual can be simulated hundreds of times."""
_SEED = 5
_ORDER = (
    "cross-correlation", "ambient difference", "ambient difference, curved", "ambient rate", "ambient rate, curved",
    "drift", "change", "change of heat",
)  # fmt: skip
_Compared = tuple[Array, str, str, str, str]
"""A robust test before its threshold: statistics (B + 1,), the first its own, others by chance; then its name, its
subject, and what it says where it is significant, and where not."""


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
    time_s, random = _coarse(time_s), np.random.default_rng(_SEED)
    residuals = {name: _coarse(row) for name, row in zip(sensors, residual_degC)}
    calibrated = {name: each for name, row in residuals.items() if (each := Calibrated.of(row, random)) is not None}
    if not calibrated:
        return ()
    step_s = float(time_s[1] - time_s[0])
    white: list[Tested] = []
    for name in calibrated:
        given, alpha = (residuals[name], name), LEVEL / (2 * len(calibrated))
        white += [ljung_box(*given, alpha), cumulated_periodogram(*given, step_s, alpha), memory(*given, step_s)]
    logged, air = {name: bridged(_coarse(row)) for name, row in signals.items()}, _coarse(ambient_degC)
    found: list[_Compared] = []
    for sensor, series in calibrated.items():
        row = sensors.index(sensor)
        simulated = bridged(_coarse(measured_degC[row] - residual_degC[row]))
        found += _along(series, sensor, logged, air, simulated, step_s)
        found += _changes(series, Calibrated.of(_coarse(heat[row]), random), sensor, time_s)
    found.sort(key=lambda each: _ORDER.index(each[1]))
    limits = thresholds([statistics[1:] for statistics, *_ in found], LEVEL)
    return (*white, *(Tested.of(*each[1:], float(each[0][0]), limit) for each, limit in zip(found, limits)))


def residual_memory_s(time_s: Array, residual_degC: Array) -> float:
    """The autocorrelation time of one sensor's residual (N,); NaN where it has no tests."""
    time_s, series = _coarse(time_s), _coarse(residual_degC)
    return math.nan if remembered(series) is None else autocorrelation_time_s(series, float(time_s[1] - time_s[0]))


def _coarse(values: Array) -> Array:
    """The means of ``values`` (N,) over as many samples each as leave at most :data:`MOST_SAMPLES`; NaN where none is
    known."""
    every = -(-len(values) // MOST_SAMPLES)
    return pd.Series(values).groupby(np.arange(len(values)) // every).mean().to_numpy()


def _along(
    series: Calibrated, sensor: str, logged: Mapping[str, Array], air: Array, simulated: Array, step_s: float
) -> Iterator[_Compared]:
    """What a residual goes along with; the difference to the ambient is the simulated node's: the measured one's noise
    is also in the residual."""

    def tested(test: str, what: str, hint: str, course: Array, given: Array | None = None) -> Iterator[_Compared]:
        """Whether it follows ``course`` (n,), the part of ``given`` taken out before, and what that would mean."""
        if np.ptp(course[series.rows]) > 0:
            responses, delays = delayed(course)
            statistics, best, size = series.along_with(responses, None if given is None else delayed(given)[0])
            delay = f"with a delay of about {duration(delays[best] * step_s)}" if delays[best] else "at once"
            said = f"the residual follows {what} {delay}, by {digits(size, 2)} degC over its range{hint}"
            otherwise = f"the residual does not follow {what} more than chance would"
            yield statistics, test, f"{sensor}, {what}" if what in logged else sensor, said, otherwise

    for name, row in logged.items():
        yield from tested("cross-correlation", name, "", row)
    if not np.isfinite(air).any():
        return
    air = bridged(air)
    if np.ptp(apart := simulated - air) > 1e-9:
        what = "the node's difference to the ambient"
        yield from tested("ambient difference", what, ": a resistance may be wrong or have changed", apart)
        hint = ": the loss may not be proportional to the difference"
        yield from tested("ambient difference, curved", f"the square of {what}", hint, curved(apart), apart)
    if np.ptp(changes := rate(air)) > 1e-9:
        what = "the ambient's rate of change"
        yield from tested("ambient rate", what, ": a mass or a delay may be missing", changes)
        hint = ": what is missing acts on fast changes only"
        yield from tested("ambient rate, curved", f"the square of {what}", hint, curved(changes), changes)


def _changes(series: Calibrated, heat: Calibrated | None, sensor: str, time_s: Array) -> Iterator[_Compared]:
    course = time_s[None] - time_s[0]
    statistics, _, size = series.without(course).along_with(course)
    said = f"the residual drifts by {digits(size, 2)} degC over {duration(time_s[-1] - time_s[0])}"
    yield statistics, "drift", sensor, said, "the residual does not drift more than its memory explains"
    changing = [("change", series, "the residual", " degC")]
    if heat is not None:
        changing.append(("change of heat", heat, "the heat that explains the residual", ""))
    for test, each, what, unit in changing:
        statistics, turns, height = each.without(levels(len(time_s))).change()
        how = f"{'rises' if height > 0 else 'falls'}{f' by {digits(abs(height), 2)}{unit}' if unit else ''}"
        times = (
            f"{' and comes back,' if len(turns) > 1 else ''} at about {' and '.join(clock(time_s[k]) for k in turns)}"
        )
        keeps = f"{what} keeps its level"
        yield statistics, test, sensor, f"{what} {how}{times}" if turns else keeps, keeps
