"""All tests of a misfit, in the order in which one reads them: is it noise, and what does it go along with."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.residual_tests.dependence import Calibrated, Dependence, thresholds
from ambient_trainer.diagnosis.residual_tests.drivers import Driver, ambient_drivers, drift_driver, signal_drivers
from ambient_trainer.diagnosis.residual_tests.grid import Grid
from ambient_trainer.diagnosis.residual_tests.noise import autoregression_of
from ambient_trainer.diagnosis.residual_tests.sentences import sentence, subject
from ambient_trainer.diagnosis.residual_tests.whiteness import autocorrelation_time, cumulated_periodogram, ljung_box
from ambient_trainer.diagnosis.result import Tested

Array = NDArray[np.float64]

LEVEL = 0.05
"""How often, without any effect, any of the robust tests of a report fails; and any of those for whiteness."""
_FEWEST_SAMPLES = 60
_SEED = 5


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

    ``time_s`` (N,) increases; ``signals`` and ``ambient_degC`` are (N,), ``measured_degC`` is (sensors, N). NaN is a
    missing value. A sensor of too few samples, or one that never changes, and a signal that never does have no test.
    """
    if len(time_s) < _FEWEST_SAMPLES:
        return ()
    grid = Grid.over(time_s)
    residuals = {name: grid.means(row) for name, row in zip(sensors, residual_degC)}
    usable = [name for name, row in residuals.items() if autoregression_of(row) is not None]
    white = [each for name in usable for each in _white(residuals[name], name, grid.step_s, len(usable))]
    shared = signal_drivers({name: values for name, raw in signals.items() if (values := grid.filled(raw)) is not None})
    ambient = grid.filled(ambient_degC)
    random = np.random.default_rng(_SEED)
    found: list[Dependence] = []
    for name, residual, flow, measured in zip(sensors, residual_degC, heat, measured_degC):
        simulated = grid.filled(measured - residual)
        felt = ambient_drivers(ambient, simulated) if ambient is not None and simulated is not None else []
        found += _of_sensor(grid, name, residual, flow, [*shared, *felt], random)
    found.sort(key=lambda each: _ORDER.index(each.test))
    return (*white, *(_tested(grid, each, limit) for each, limit in zip(found, thresholds(found, LEVEL))))


def _white(series: Array, sensor: str, step_s: float, sensors: int) -> Iterator[Tested]:
    alpha = LEVEL / (2 * sensors)
    yield ljung_box(series, sensor, alpha)
    yield cumulated_periodogram(series, sensor, step_s, alpha)
    yield autocorrelation_time(series, sensor, step_s)


_ORDER = (
    "cross-correlation",
    "ambient difference",
    "ambient difference, curved",
    "ambient rate",
    "ambient rate, curved",
    "drift",
    "change",
    "change of heat",
)


def _of_sensor(
    grid: Grid, sensor: str, residual: Array, heat: Array, drivers: Sequence[Driver], random: np.random.Generator
) -> list[Dependence]:
    series = Calibrated.of(grid.means(residual), sensor, random)
    if series is None:
        return []
    found = [each for driver in drivers if (each := series.along_with(driver))]
    found += [each for each in (series.drift(drift_driver(grid.samples)), series.change("change")) if each]
    flow = Calibrated.of(grid.means(heat), sensor, random)
    if flow is not None:
        found.append(flow.change("change of heat"))
    return found


def _tested(grid: Grid, found: Dependence, threshold: float) -> Tested:
    significant = found.statistic > threshold
    return Tested(
        found.test, subject(found), found.statistic, threshold, significant, sentence(found, significant, grid)
    )
