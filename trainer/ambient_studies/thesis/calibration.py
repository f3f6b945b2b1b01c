"""Calibration of the simulated phone: bounded least squares in the logarithms of its constants.

Every Jacobian is one batch of simulations. Where the published figures do not determine a constant, its prior does:
the engineer's guess, with a standard deviation of one in the logarithm.

Candidates are compared by the statistics of their raw sensors and by the errors of the thesis's static formulas, both
without noise and rounding, which the calibration shall not fit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from ambient_studies.thesis import published as thesis
from ambient_trainer.circuits import assemble, load_circuit
from ambient_trainer.data import Array
from ambient_trainer.evaluation import Metrics, score
from ambient_trainer.lti import dc_gain
from ambient_trainer.simulator import Constant, Driven, integrate, load_device, load_scenario, prepare

SCENARIOS = (*thesis.CONSTANT_SCENARIOS, "3")
"""What candidates go through; 4 and 5 are left for the evaluation."""

FORMULAS = ("linear_battery", "linear_usb", "linear_flash", "linear_combined", "model1_kirchhoff", "model2_ss_free_cd")
"""Models whose published parameters constrain the sensors; the last by its DC gains."""

PERIOD_S = 2.0
_SENSORS = load_device().sensors


class Formula(NamedTuple):
    """ambient = gains . sensors + offset."""

    gains: Array
    offset: float


class Recorded(NamedTuple):
    """One scenario without instruments' errors: the air, shape (n,), and what the five sensors feel, (5, n)."""

    air_degC: Array
    sensors_degC: Array


@cache
def formulas() -> dict[str, Formula]:
    """The published formulas at steady state, errata applied."""
    found = {}
    for model in FORMULAS:
        circuit = load_circuit(model)
        system = assemble(circuit, thesis.published_parameters()[model].corrected).value
        gains = np.zeros(len(_SENSORS))
        gains[[_SENSORS.index(column.removesuffix("_degC")) for column in circuit.inputs]] = dc_gain(system)[0]
        found[model] = Formula(gains, float(system.offset[0]))
    return found


def record(candidates: Sequence[Mapping[str, float]], seed: int) -> list[dict[str, Recorded]]:
    """Simulate every candidate in all ``SCENARIOS``, in one integration."""
    runs = []
    for values in candidates:
        device = load_device().with_values(values)
        runs += [prepare(load_scenario(name), seed, PERIOD_S, device) for name in SCENARIOS]
    recorded = [_recorded(each) for each in integrate(runs, PERIOD_S)]
    size = len(SCENARIOS)
    return [dict(zip(SCENARIOS, recorded[start : start + size])) for start in range(0, len(recorded), size)]


def statistics(recorded: Mapping[str, Recorded]) -> dict[tuple[str, str], thesis.SensorStatistics]:
    """Mean and standard deviation by scenario and sensor, for all that were published."""
    found = {}
    for scenario, sensor in thesis.sensor_statistics():
        values = recorded[scenario].sensors_degC[_SENSORS.index(sensor)]
        found[scenario, sensor] = thesis.SensorStatistics(float(values.mean()), float(values.std()))
    return found


def formula_errors(recorded: Mapping[str, Recorded]) -> dict[tuple[str, str], Metrics]:
    """Errors of the published formulas on what was recorded, by scenario and model."""
    return {
        (scenario, model): score(air_degC - gains @ sensors_degC - offset)
        for scenario, (air_degC, sensors_degC) in recorded.items()
        for model, (gains, offset) in formulas().items()
        if (scenario, model) in thesis.published_results()
    }


def _recorded(driven: Driven) -> Recorded:
    kept = slice(driven.run.unrecorded, None)
    device = driven.run.device
    sensors = [device.felt(zone, driven.nodes_degC, PERIOD_S)[kept] for zone in device.main_zones]
    return Recorded(driven.run.air_degC[kept], np.array(sensors))


Progress = Callable[[int, float], None]
"""Called with the number of evaluations and the lowest cost so far."""

# the misfits that count as one; the bars of the outcome are 1 degC and 30 %
MEAN_DEGC = 0.3
STD_FRAC = 0.1
PRIOR_LOG = 1.0  # a constant that differs from its guess by a factor of 2.7
RMSE_FRAC, MAE_FRAC, MBE_DEGC, MBE_FRAC = 0.2, 0.25, 0.3, 0.15
FORMULA_WEIGHT = 0.5  # where the statistics of raw sensors hold most of the same information

_STEP = 1e-3
_INSIDE = 1e-6


@dataclass(frozen=True)
class Calibration:
    """The fitted values by name, the cost at the guesses and at the end, and the number of evaluations."""

    values: dict[str, float]
    cost_before: float
    cost: float
    evaluations: int


def residuals(recorded: Mapping[str, Recorded]) -> Array:
    """The misfits of a candidate's recordings to the published figures, in the units above."""
    misfits = []
    simulated = statistics(recorded)
    for key, published in thesis.sensor_statistics().items():
        misfits.append((simulated[key].mean_degC - published.mean_degC) / MEAN_DEGC)
        if published.std_degC is not None:
            misfits.append(np.log((simulated[key].std_degC or np.nan) / published.std_degC) / STD_FRAC)
    for (scenario, model), errors in formula_errors(recorded).items():
        wanted = thesis.published_results()[scenario, model]
        weight = FORMULA_WEIGHT if scenario in thesis.CONSTANT_SCENARIOS else 1.0
        misfits += [
            weight * np.log(errors.rmse_degC / wanted.rmse_degC) / RMSE_FRAC,
            weight * np.log(errors.mae_degC / wanted.mae_degC) / MAE_FRAC,
            weight * (errors.mbe_degC - wanted.mbe_degC) / (MBE_DEGC + MBE_FRAC * wanted.rmse_degC),
        ]
    return np.array(misfits)


def calibrate(
    constants: Mapping[str, Constant], budget: int, seed: int = 0, progress: Progress | None = None
) -> Calibration:
    """Fit the constants to the published figures, in ``budget`` evaluations at most.

    Minimises |r(c)|^2 / 2 + |log(c / guess) / PRIOR_LOG|^2 / 2 over log c within the bounds (trust region reflective,
    ``scipy.optimize.least_squares``), with r of :func:`residuals` and forward differences. Weather and noise follow
    from ``seed``: the same arguments give the same values.
    """
    with threadpool_limits(1):
        search = _Search(constants, seed, progress)
        start = np.clip(search.guess, search.low + _INSIDE, search.high - _INSIDE)
        found = least_squares(
            search.at, start, search.jacobian, (search.low, search.high), max_nfev=budget, xtol=1e-4, ftol=1e-4
        )
    return Calibration(search.values(found.x), search.costs[0], float(found.cost), int(found.nfev))


class _Search:
    def __init__(self, constants: Mapping[str, Constant], seed: int, progress: Progress | None) -> None:
        self.names = tuple(constants)
        self.guess, self.low, self.high = (
            np.log([getattr(each, name) for each in constants.values()]) for name in ("start", "low", "high")
        )
        self.costs: list[float] = []
        self._seed = seed
        self._progress = progress

    def values(self, theta: Array) -> dict[str, float]:
        return dict(zip(self.names, np.exp(theta).tolist()))

    def at(self, theta: Array) -> Array:
        found = self._batch([theta])[0]
        self.costs.append(0.5 * float(found @ found))
        if self._progress:
            self._progress(len(self.costs), min(self.costs))
        return found

    def jacobian(self, theta: Array) -> Array:
        steps = np.where(theta + _STEP < self.high, _STEP, -_STEP)
        base, *moved = self._batch([theta, *(theta + np.diag(steps))])
        return np.stack([(each - base) / step for each, step in zip(moved, steps)], axis=1)

    def _batch(self, thetas: list[Array]) -> list[Array]:
        recorded = record([self.values(theta) for theta in thetas], self._seed)
        prior = ((theta - self.guess) / PRIOR_LOG for theta in thetas)
        return [np.concatenate([residuals(each), one]) for each, one in zip(recorded, prior)]
