"""Fits the error variance: it grows with the estimate's rate of change and with its distance from the secondary one.

The terms are those of ``ambient_model.error_variance``; their weights, none negative, are found by least squares of the
squared errors, each over the variance found before (iterated non-negative least squares: Lawson and Hanson 1974,
chapter 23). The quantiles are of the error in units of its standard deviation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ambient_model.model import LEVELS_PERCENT, ErrorVariance, Term
from ambient_trainer.estimation.error_variance import unrest_degC2
from ambient_trainer.estimators.blended.filters import Filters
from ambient_trainer.estimators.blended.recipe import Recipe
from ambient_trainer.estimators.blended.training_set import TrainingSet

Array = NDArray[np.float64]

_ROUNDS = 8
_LEAST_VARIANCE_DEGC2 = 1e-4
_EVERY_S = 11.0


def fit_spread(recipe: Recipe, filters: Filters, runs: TrainingSet) -> ErrorVariance:
    """The error variance model of ``filters`` over ``runs``, weighed by the recipe."""
    period_s, lags = filters.main.period_s, recipe.spread
    kinds = (Term("movement", lags.movement_lag_s, 1.0), Term("guard", lags.guard_lag_s, 1.0))
    stride = max(1, round(_EVERY_S / period_s))
    errors, terms, weights = [], [], []
    for name, count in recipe.weights.interval.items():
        for run in runs[name]:
            estimate, _, apart = filters.published(run.sensors_degC)
            errors.append((run.target_degC - estimate)[::stride])
            unrest = [unrest_degC2(kind, estimate, apart, period_s)[::stride] for kind in kinds]
            terms.append(np.vstack([np.ones_like(errors[-1]), *unrest]))
            weights.append(np.full(len(errors[-1]), count / len(runs[name]) / len(errors[-1])))
    error, table, weight = np.concatenate(errors), np.concatenate(terms, axis=1), np.concatenate(weights)
    found = fit_variance(error, table, weight)
    reach = np.abs(error) / np.sqrt(np.maximum(found @ table, _LEAST_VARIANCE_DEGC2))
    quantiles = {level: weighted_quantile(reach, weight, level / 100) for level in LEVELS_PERCENT}
    constant, *factors = found.tolist()
    return ErrorVariance(
        constant_degC2=max(constant, _LEAST_VARIANCE_DEGC2),
        terms=tuple(kind._replace(weight=factor) for kind, factor in zip(kinds, factors)),
        quantiles={level: (-each, each) for level, each in quantiles.items()},
    )


def fit_variance(error: Array, terms: Array, weight: Array) -> Array:
    """The weights, none negative, with which ``terms`` (q, N) make the variance of ``error`` (N,)."""
    variance = np.full(len(error), np.average(error**2, weights=weight))
    for _ in range(_ROUNDS):
        row = np.sqrt(weight) / variance
        found, _ = nnls((terms * row).T, error**2 * row)
        variance = np.maximum(found @ terms, _LEAST_VARIANCE_DEGC2)
    return np.asarray(found)


def weighted_quantile(values: Array, weight: Array, share: float) -> float:
    """The value below which ``share`` of the weight lies."""
    order = np.argsort(values)
    return float(np.interp(share, np.cumsum(weight[order]) / weight.sum(), values[order]))
