"""The search: bounded least squares in the logarithms of the constants, every Jacobian one batch of simulations.

What the published figures do not tell is decided by the prior: each constant is drawn to its engineer's guess.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from ambient_studies.calibration.figures import Recorded, formula_errors, record, statistics
from ambient_studies.calibration.published import CONSTANT_SCENARIOS, published_errors, sensor_figures
from ambient_trainer.simulator.calibrated import Constant

Array = NDArray[np.float64]
Progress = Callable[[int, float], None]
"""Told the number of evaluations done and the best cost so far."""

# what a residual of one means; the bars are 1 degC and 30 %
MEAN_DEGC = 0.3
STD_FRAC = 0.1
PRIOR_LOG = 1.0  # a constant off its guess by a factor of 2.7
RMSE_FRAC, MAE_FRAC, MBE_DEGC, MBE_FRAC = 0.2, 0.25, 0.3, 0.15
FORMULA_WEIGHT = 0.5  # where raw sensors' statistics already say most of it

_STEP = 1e-3
_INSIDE = 1e-6


@dataclass(frozen=True)
class Calibration:
    """The values found, by name, the cost at the guesses and at the end, and the evaluations that it took."""

    values: dict[str, float]
    cost_before: float
    cost: float
    evaluations: int


def residuals(recorded: Mapping[str, Recorded]) -> Array:
    """What a candidate's recordings miss of the published figures, in the units above."""
    missed = []
    found = statistics(recorded)
    for each in sensor_figures():
        mean, std = found[each.scenario, each.sensor]
        missed.append((mean - each.mean_degC) / MEAN_DEGC)
        if each.std_degC is not None:
            missed.append(np.log(std / each.std_degC) / STD_FRAC)
    for (scenario, model), errors in formula_errors(recorded).items():
        wanted = published_errors()[scenario, model]
        weight = FORMULA_WEIGHT if scenario in CONSTANT_SCENARIOS else 1.0
        missed += [
            weight * np.log(errors.rmse_degC / wanted.rmse_degC) / RMSE_FRAC,
            weight * np.log(errors.mae_degC / wanted.mae_degC) / MAE_FRAC,
            weight * (errors.mbe_degC - wanted.mbe_degC) / (MBE_DEGC + MBE_FRAC * wanted.rmse_degC),
        ]
    return np.array(missed)


def calibrate(
    constants: Mapping[str, Constant], budget: int, seed: int = 0, progress: Progress | None = None
) -> Calibration:
    """Search from the guesses for at most ``budget`` evaluations; the same arguments give the same values."""
    with threadpool_limits(1):
        search = _Search(constants, seed, progress)
        start = np.clip(search.guess, search.low + _INSIDE, search.high - _INSIDE)
        found = least_squares(
            search.at, start, search.jacobian, (search.low, search.high), max_nfev=budget, xtol=1e-4, ftol=1e-4
        )
    return Calibration(search.values(found.x), search.first_cost, float(found.cost), int(found.nfev))


class _Search:
    def __init__(self, constants: Mapping[str, Constant], seed: int, progress: Progress | None) -> None:
        self.names = tuple(constants)
        self.guess, self.low, self.high = (
            np.log([getattr(each, name) for each in constants.values()]) for name in ("start", "low", "high")
        )
        self.first_cost = self._best = np.inf
        self._evaluations = 0
        self._seed = seed
        self._progress = progress

    def values(self, theta: Array) -> dict[str, float]:
        return dict(zip(self.names, np.exp(theta).tolist()))

    def at(self, theta: Array) -> Array:
        found = self._batch([theta])[0]
        cost = 0.5 * float(found @ found)
        if not self._evaluations:
            self.first_cost = cost
        self._evaluations += 1
        self._best = min(self._best, cost)
        if self._progress:
            self._progress(self._evaluations, self._best)
        return found

    def jacobian(self, theta: Array) -> Array:
        steps = np.where(theta + _STEP < self.high, _STEP, -_STEP)
        base, *moved = self._batch([theta, *(theta + np.diag(steps))])
        return np.stack([(each - base) / step for each, step in zip(moved, steps)], axis=1)

    def _batch(self, thetas: list[Array]) -> list[Array]:
        recorded = record([self.values(theta) for theta in thetas], self._seed)
        drawn = ((theta - self.guess) / PRIOR_LOG for theta in thetas)
        return [np.concatenate([residuals(each), prior]) for each, prior in zip(recorded, drawn)]
