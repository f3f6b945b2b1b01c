"""Fits the main filter, the secondary one and the fallbacks, each by a search of its own, and their error variance.

All searches but the first start where the main filter's ended.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ambient_model.model import ErrorVariance, Term
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.budget import Cancelled
from ambient_trainer.estimation.error_variance import WeightedRun, fit_weighted_error_variance, regressors_degC2
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimators.blended.poles import (
    Objective,
    Searched,
    dc_gains,
    first_unknowns,
    noise_gram,
    numerators,
    search_poles,
    signals,
)
from ambient_trainer.estimators.blended.recipe import LOGGED, Recipe
from ambient_trainer.estimators.blended.training_set import TrainingRun, TrainingSet
from ambient_trainer.estimators.estimate import Blended, blended
from ambient_trainer.lti.statespace import StateSpace

Array = NDArray[np.float64]

STATES = 4


@dataclass(frozen=True)
class TrainedFilter:
    """Poles and weights over the trace columns ``inputs``, at ``period_s``."""

    inputs: tuple[str, ...]
    period_s: float
    found: Searched

    def estimate_degC(self, sensors_degC: Array) -> Array:
        """The estimate (N,) over sensors (m, N), from equilibrium with the first sample."""
        weights = self.found.weights
        return np.asarray(weights[:-1] @ signals(self.found.poles, self.period_s, sensors_degC) + weights[-1])

    @property
    def noise_gain(self) -> float:
        """The output's standard deviation per that of white noise, independent in every input, at its period."""
        weights = self.found.weights[:-1]
        return float(np.sqrt(weights @ noise_gram(self.found.poles, self.period_s, len(self.inputs)) @ weights))

    @property
    def dc_gains(self) -> dict[str, float]:
        """Per input the DC gain."""
        gains = dc_gains(len(self.inputs)) @ self.found.weights[:-1]
        return dict(zip(self.inputs, gains.tolist()))

    @property
    def time_constants_s(self) -> list[complex]:
        """-1/pole, slowest first; a damped pair is complex."""
        return self._free_filter().time_constants_s(self.found.poles)

    def system(self) -> StateSpace:
        """The continuous system that is this filter under a first-order hold, of four states.

        A state is what one mode adds to the estimate, in degC, so that a norm shows the decay of a wrong start.
        """
        direct, sections = numerators(self.found.poles, self.period_s, self.found.weights[:-1])
        gains = np.concatenate([direct, self.found.weights[-1:], *(each.ravel() for each in sections)])
        system = self._free_filter().system(self.found.poles, gains)
        modes = block_diag(*(_modes(block) for block in (system.A[:2, :2], system.A[2:, 2:])))
        return StateSpace(
            np.linalg.solve(modes, system.A @ modes),
            np.linalg.solve(modes, system.B),
            system.C @ modes,
            system.D,
            system.offset,
        )

    def _free_filter(self) -> FreeFilter:
        """The structure whose poles and gains these are; it takes period and inputs from a segment."""
        shape = np.zeros((len(self.inputs), 3))
        return FreeFilter(STATES, [Segment(self.period_s, shape, np.zeros((1, 3)))])


def _modes(A: Array) -> Array:
    """The eigenvectors of a companion matrix [[0, 1], [a, b]], or real and imaginary part of one, as columns."""
    first, second = np.linalg.eigvals(A)
    if np.iscomplex(first):
        return np.array([[1.0, 0.0], [first.real, first.imag]])
    return np.array([[1.0, 1.0], [first.real, second.real]])


Show = Callable[[int, float], None]
"""Called with the number of evaluations and the objective."""


@dataclass(frozen=True)
class Filters:
    """The filters of a recipe."""

    main: TrainedFilter
    secondary: TrainedFilter
    threshold_degC: float
    fallbacks: dict[str, TrainedFilter]
    """By the sensor that each does without."""
    stopped: bool = False
    """Whether the user stopped it before all fallbacks were fitted."""

    def published(self, sensors_degC: Array) -> Blended:
        """The blended estimate over sensors (m, N)."""
        main, secondary = (each.estimate_degC(sensors_degC) for each in (self.main, self.secondary))
        return blended(main, secondary, self.threshold_degC)


def fit_filters(recipe: Recipe, runs: TrainingSet, period_s: float, stage: Callable[[int], Show]) -> Filters:
    """The filters fitted to ``runs``; ``stage`` gives the progress callback of the search of that number.

    Cancelled, it leaves out the fallbacks that are not done; before the first it raises :class:`Cancelled`.
    """
    columns, weights, rules = recipe.sensor_columns, recipe.weights, recipe.filter
    start = first_unknowns(rules)

    def search(inputs: Sequence[str], runs: TrainingSet, counts: Mapping[str, float], number: int) -> TrainedFilter:
        nonlocal start
        found, reached = search_poles(Objective(runs, counts, rules, period_s), rules, start, stage(number))
        if number == 0:
            start = reached
        return TrainedFilter(tuple(inputs), period_s, found)

    main = search(columns, runs, weights.main, 0)
    secondary = search(columns, runs, weights.guard, 1)
    fallbacks: dict[str, TrainedFilter] = {}
    stopped = False
    try:
        for index, name in enumerate(recipe.sensors):
            fewer = {key: [each.without(index) for each in several] for key, several in runs.items()}
            fallbacks[name] = search([*columns[:index], *columns[index + 1 :]], fewer, weights.main, 2 + index)
    except Cancelled:
        stopped = True
    threshold_degC = _threshold(recipe, main, secondary, runs[LOGGED])
    return Filters(main, secondary, threshold_degC, fallbacks, stopped)


def _threshold(recipe: Recipe, main: TrainedFilter, secondary: TrainedFilter, logged: Sequence[TrainingRun]) -> float:
    apart = [main.estimate_degC(each.sensors_degC) - secondary.estimate_degC(each.sensors_degC) for each in logged]
    rule = recipe.threshold
    return rule.times * float(np.percentile(np.abs(np.concatenate(apart)), rule.percent))


_EVERY_S = 11.0


def fit_error_variance(recipe: Recipe, filters: Filters, runs: TrainingSet) -> ErrorVariance:
    """The error variance model of ``filters`` over ``runs``, weighed by the recipe."""
    period_s, lags = filters.main.period_s, recipe.spread
    terms = (Term("movement", lags.movement_lag_s, 1.0), Term("guard", lags.guard_lag_s, 1.0))
    stride = max(1, round(_EVERY_S / period_s))
    weighted = []
    for name, count in recipe.weights.interval.items():
        for run in runs[name]:
            estimate, _, apart = filters.published(run.sensors_degC)
            error = (run.target_degC - estimate)[::stride]
            table = regressors_degC2(terms, estimate, apart, period_s)[:, ::stride]
            weighted.append(WeightedRun(error, table, count / len(runs[name]) / len(error)))
    return fit_weighted_error_variance(terms, weighted)
