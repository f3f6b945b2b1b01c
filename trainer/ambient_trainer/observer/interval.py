"""How wrong the estimate is to be thought: a variance that grows with its movement and with what the guard objects.

The terms are those of ``ambient_model.spread``, here over arrays; their weights, none negative, are found by least
squares of the squared errors, each over the variance found before (iterated non-negative least squares: Lawson and
Hanson 1974, chapter 23). The quantiles are of the error in units of its standard deviation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.signal import lfilter

from ambient_model.model import LEVELS_PERCENT, Spread, Term
from ambient_trainer.observer.bank import Bank
from ambient_trainer.observer.recipe import Recipe, SpreadLags
from ambient_trainer.observer.teaching import Lessons

Array = NDArray[np.float64]

_ROUNDS = 8
_LEAST_VARIANCE_DEGC2 = 1e-4
_EVERY_S = 11.0


def fit_spread(recipe: Recipe, bank: Bank, lessons: Lessons) -> Spread:
    """The spread that the errors of ``bank`` in ``lessons`` call for, weighed as the recipe says."""
    period_s, lags = bank.main.period_s, recipe.spread
    stride = max(1, round(_EVERY_S / period_s))
    errors, terms, weights = [], [], []
    for name, count in recipe.weights.interval.items():
        for lesson in lessons[name]:
            estimate, apart = bank.published(lesson.sensors_degC)
            errors.append((lesson.target_degC - estimate)[::stride])
            terms.append(spread_terms(lags, estimate, apart, period_s)[:, ::stride])
            weights.append(np.full(len(errors[-1]), count / len(lessons[name]) / len(errors[-1])))
    error, table, weight = np.concatenate(errors), np.concatenate(terms, axis=1), np.concatenate(weights)
    found = fit_variance(error, table, weight)
    reach = np.abs(error) / np.sqrt(np.maximum(found @ table, _LEAST_VARIANCE_DEGC2))
    quantiles = {level: weighted_quantile(reach, weight, level / 100) for level in LEVELS_PERCENT}
    constant, movement, guard = found.tolist()
    return Spread(
        constant_degC2=constant,
        terms=(
            Term("movement", lags.movement_lag_s, movement),
            Term("guard", lags.guard_lag_s, guard),
        ),
        quantiles={level: (-each, each) for level, each in quantiles.items()},
    )


def spread_terms(lags: SpreadLags, estimate: Array, apart: Array, period_s: float) -> Array:
    """One, movement and guard over the published estimate and how far main and guard are apart: (3, N)."""
    off_mean = estimate - _low_pass(estimate, lags.movement_lag_s, period_s)
    return np.vstack(
        [
            np.ones_like(estimate),
            _low_pass(off_mean**2, lags.movement_lag_s, period_s),
            _low_pass(apart**2, lags.guard_lag_s, period_s),
        ]
    )


def sigma_degC(spread: Spread, estimate: Array, apart: Array, period_s: float) -> Array:
    """The standard deviation (N,) that :func:`fit_spread`'s spread gives these."""
    movement, guard = spread.terms
    terms = spread_terms(SpreadLags(movement_lag_s=movement.lag_s, guard_lag_s=guard.lag_s), estimate, apart, period_s)
    return np.asarray(np.sqrt(np.array([spread.constant_degC2, movement.weight, guard.weight]) @ terms))


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


def _low_pass(values: Array, lag_s: float, period_s: float) -> Array:
    kept = np.exp(-period_s / lag_s)
    return np.asarray(lfilter([1 - kept], [1.0, -kept], values - values[0]) + values[0])
