"""Fits the main filter, the secondary one and the fallbacks, each by a search of its own.

All searches but the first start where the main filter's ended.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.estimation.budget import Cancelled
from ambient_trainer.estimators.blended.objective import Objective
from ambient_trainer.estimators.blended.poles import first_unknowns, search_poles
from ambient_trainer.estimators.blended.recipe import LOGGED, Recipe
from ambient_trainer.estimators.blended.trained_filter import TrainedFilter
from ambient_trainer.estimators.blended.training_set import TrainingRun, TrainingSet
from ambient_trainer.estimators.estimate import Blended, blended

Array = NDArray[np.float64]

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
