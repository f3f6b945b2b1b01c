"""Fits the main filter, the secondary one and the fallbacks to weighted runs, and their error variance.

Each minimises, over its poles and weights,

    sum_l k_l mean (target_l - estimate_l)^2 + noise N^2 + one_degree (sum of DC gains - 1)^2,

l being the training runs and N the noise gain. Two poles are real and slow, bounded below the age of the log, and a
damped pair inverts the lags; the recipe has weights and bounds. All searches but the first start where the main
filter's ended.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ambient_model.model import ErrorVariance, Term
from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.error_variance import fit_weighted_error_variance, regressors_degC2
from ambient_trainer.estimation.free_filter import FreeFilter, Run, weighted_filter
from ambient_trainer.estimation.search import Progress, search
from ambient_trainer.estimation.structure import Unknowns
from ambient_trainer.estimators.base import Effort, Fit, SecondaryFit
from ambient_trainer.estimators.blended.recipe import FilterRules, Recipe
from ambient_trainer.estimators.blended.training_set import TrainingRun, TrainingSet
from ambient_trainer.estimators.estimate import Blended, blended
from ambient_trainer.estimators.observer import fallbacks_of, filter_fit

_STATES = 4
_MOST_RATIO = 20.0
_MOST_DAMPING = 20.0


def recipe_filter(runs: TrainingSet, counts: Mapping[str, float], rules: FilterRules, period_s: float) -> FreeFilter:
    """The filter of four states over the runs that ``counts`` weighs, within the bounds of ``rules``."""
    weighted = [
        _weighted(each, count / len(runs[name]), period_s)
        for name, count in counts.items()
        if count
        for each in runs[name]
    ]
    found = weighted_filter(_STATES, weighted, math.sqrt(rules.one_degree), math.sqrt(rules.noise))
    slow, fast = sorted(rules.slow.time_constants_s), rules.fast
    # two rates r and r q: omega^2 = r^2 q, zeta = (1 + q) / (2 sqrt q) = cosh(log q / 2)
    found.search = Unknowns(
        found.search.names,
        np.log([1 / math.sqrt(slow[0] * slow[1]), _damping(slow[1] / slow[0]), 1 / fast.time_s, fast.damping]),
        np.log([1 / rules.slow.slowest_s, _damping(rules.slow.least_ratio)] * 2),
        np.log([1 / (2 * period_s), _damping(_MOST_RATIO), 1 / (2 * period_s), _MOST_DAMPING]),
    )
    found.search.low[3] = math.log(fast.least_damping)
    found.slowest = -math.log(rules.slow.slowest_s)
    return found


def _damping(ratio: float) -> float:
    """The damping of two real poles of that ratio."""
    return math.cosh(math.log(ratio) / 2)


def _weighted(run: TrainingRun, count: float, period_s: float) -> Run:
    target = np.full_like(run.target_degC, np.nan)
    target[:: run.stride] = run.target_degC[:: run.stride]
    weight = math.sqrt(count / len(target[:: run.stride]))
    return Run(Segment(period_s, run.sensors_degC, target[None]), weight, run.absolute)


def published(fit: Fit, segment: Segment) -> Blended:
    """The estimate of a fit blended with its secondary one's, over a segment."""
    assert fit.secondary is not None
    return blended(fit.over(segment), fit.secondary.fit.over(segment), fit.secondary.threshold_degC)


def fit_filters(
    recipe: Recipe, runs: TrainingSet, logged: Sequence[Segment], effort: Effort, progress: Progress | None
) -> Fit:
    """The main filter with its secondary one and fallbacks; ``progress`` gets the number of the search.

    Cancelled, it leaves out the fallbacks that are not done; before the first it raises :class:`Cancelled`.
    """
    columns, weights, period_s = recipe.sensor_columns, recipe.weights, logged[0].period_s
    start: Array | None = None

    def fitted(number: int, counts: Mapping[str, float], without: int | None = None) -> Fit:
        nonlocal start
        kept = [index for index in range(len(columns)) if index != without]
        fewer = {name: [each.of(kept) for each in several] for name, several in runs.items()}
        structure = recipe_filter(fewer, counts, recipe.filter, period_s)
        if start is not None:
            structure.search = replace(structure.search, initial=start)
        show = progress and (lambda _, evaluation, square: progress(number, evaluation, square))
        result = search(structure, 1, effort.seed, show, effort.budget)
        start = result.best.theta if start is None else start
        names, segments = [columns[index] for index in kept], [each.of(kept) for each in logged]
        return filter_fit(recipe.name, names, segments, _STATES, result, effort)

    main = fitted(0, weights.main)
    secondary = fitted(1, weights.secondary)
    effort.budget.cancel.check()
    fallbacks, _ = fallbacks_of(main, lambda index: fitted(2 + index, weights.main, index))
    differences = np.concatenate([main.over(each) - secondary.over(each) for each in logged])
    threshold = recipe.threshold.times * float(np.percentile(np.abs(differences), recipe.threshold.percent))
    stopped = len(fallbacks) < len(recipe.sensors)
    return replace(main, secondary=SecondaryFit(secondary, threshold), fallbacks=fallbacks, stopped=stopped)


_EVERY_S = 11.0


def fit_error_variance(recipe: Recipe, fit: Fit, runs: TrainingSet, period_s: float) -> ErrorVariance:
    """The error variance model of ``fit`` over ``runs``, weighed by the recipe."""
    lags = recipe.error_variance
    terms = (Term("movement", lags.movement_lag_s, 1.0), Term("guard", lags.secondary_lag_s, 1.0))
    stride = max(1, round(_EVERY_S / period_s))
    errors, tables, weights = [], [], []
    for name, count in recipe.weights.interval.items():
        for run in runs[name]:
            estimate, _, apart = published(fit, Segment(period_s, run.sensors_degC, run.target_degC[None]))
            errors.append((run.target_degC - estimate)[::stride])
            tables.append(regressors_degC2(terms, estimate, apart, period_s)[:, ::stride])
            weights.append(np.full(len(errors[-1]), count / len(runs[name]) / len(errors[-1])))
    weight = np.concatenate(weights)
    return fit_weighted_error_variance(terms, np.concatenate(errors), np.concatenate(tables, axis=1), weight)
