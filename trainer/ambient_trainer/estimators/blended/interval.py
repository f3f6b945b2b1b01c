"""Error variance model of an observer's filters: regressors and weights of the runs by its recipe."""

from __future__ import annotations

from ambient_model.model import ErrorVariance, Term
from ambient_trainer.estimation.error_variance import WeightedRun, fit_weighted_error_variance, regressors_degC2
from ambient_trainer.estimators.blended.filters import Filters
from ambient_trainer.estimators.blended.recipe import Recipe
from ambient_trainer.estimators.blended.training_set import TrainingSet

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
