"""Main, guard and fallbacks: each filter is searched for by itself, the fallbacks from where the main one was found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.estimation.budget import Cancelled
from ambient_trainer.estimators.blended.objective import Objective
from ambient_trainer.estimators.blended.poles import first_unknowns, search_poles
from ambient_trainer.estimators.blended.recipe import LOGGED, Recipe
from ambient_trainer.estimators.blended.trained_filter import TaughtFilter
from ambient_trainer.estimators.blended.training_set import Lesson, Lessons
from ambient_trainer.estimators.published import Guarded, guarded

Array = NDArray[np.float64]

Told = Callable[[int, float], None]


@dataclass(frozen=True)
class Bank:
    """The filters of an observer."""

    main: TaughtFilter
    guard: TaughtFilter
    threshold_degC: float
    fallbacks: dict[str, TaughtFilter]
    """By the sensor that each does without."""
    stopped: bool = False
    """Whether the user did not wait for all fallbacks."""

    def published(self, sensors_degC: Array) -> Guarded:
        """What main and guard say together over sensors (m, N)."""
        main, guard = (each.estimate_degC(sensors_degC) for each in (self.main, self.guard))
        return guarded(main, guard, self.threshold_degC)


def taught(recipe: Recipe, lessons: Lessons, period_s: float, stage: Callable[[int], Told]) -> Bank:
    """The bank that ``lessons`` teach; ``stage`` gives what hears the progress of the search of that number.

    Cancelled, it leaves out the fallbacks that are not done; before the first it raises :class:`Cancelled`.
    """
    columns, weights, rules = recipe.sensor_columns, recipe.weights, recipe.filter
    start = first_unknowns(rules)

    def search(inputs: Sequence[str], lessons: Lessons, counts: Mapping[str, float], number: int) -> TaughtFilter:
        nonlocal start
        found, reached = search_poles(Objective(lessons, counts, rules, period_s), rules, start, stage(number))
        if number == 0:
            start = reached
        return TaughtFilter(tuple(inputs), period_s, found)

    main = search(columns, lessons, weights.main, 0)
    guard = search(columns, lessons, weights.guard, 1)
    fallbacks: dict[str, TaughtFilter] = {}
    stopped = False
    try:
        for index, name in enumerate(recipe.sensors):
            fewer = {key: [each.without(index) for each in several] for key, several in lessons.items()}
            fallbacks[name] = search([*columns[:index], *columns[index + 1 :]], fewer, weights.main, 2 + index)
    except Cancelled:
        stopped = True
    return Bank(main, guard, _threshold(recipe, main, guard, lessons[LOGGED]), fallbacks, stopped)


def _threshold(recipe: Recipe, main: TaughtFilter, guard: TaughtFilter, logged: Sequence[Lesson]) -> float:
    apart = [main.estimate_degC(each.sensors_degC) - guard.estimate_degC(each.sensors_degC) for each in logged]
    rule = recipe.threshold
    return rule.times * float(np.percentile(np.abs(np.concatenate(apart)), rule.percent))
