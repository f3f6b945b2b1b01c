"""Error variance model: sigma^2 = constant + sum of weight x regressor, fitted to the errors of training runs.

The regressors are those of ``ambient_model.error_variance``. Two objectives find the weights, none negative:

- :func:`student_weights`, for one kind of run: those with which Student's t distribution makes the errors most likely.
  Its tails are wide: a few large errors in a jump do not widen the interval of quiet hours.
- :func:`least_squares_weights`, for runs of several kinds that are weighed: least squares of the squared errors, each
  over the variance of the round before (iterated non-negative least squares: Lawson and Hanson 1974, chapter 23).

Quantiles are of the errors themselves, in units of their standard deviation.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize, nnls

from ambient_model.model import LEVELS_PERCENT, ErrorVariance, Quantiles, Term
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import low_pass

_LAGS_PERIODS = (1, 3, 10, 30, 100)
"""None below a period: what such a lag lets through depends on how often a device ticks."""
_LAGS_IN_DATA = 50
_FREEDOM = 3.0
_LEAST = 1e-6
"""The share of the whole variance below which a term is none."""
_ROUNDS = 8
_LEAST_VARIANCE_DEGC2 = 1e-4
_INTERVAL = 90
_SHOWN_PERCENT = (10, 50, 90, 99)


class Moment(NamedTuple):
    """An estimate without gaps and its reference, NaN where there is none: (N,) each."""

    estimate_degC: Array
    reference_degC: Array


def fit_error_variance(moments: Sequence[Moment], period_s: float) -> ErrorVariance:
    """Error variance model of one estimator, with terms of its rate of change by lags that the runs are long for."""
    samples = max(len(each.estimate_degC) for each in moments)
    lags = [periods for periods in _LAGS_PERIODS if periods * _LAGS_IN_DATA <= samples] or [1]
    wanted = tuple(Term("movement", periods * period_s, 1.0) for periods in lags)
    errors = np.concatenate([each.reference_degC - each.estimate_degC for each in moments])
    estimates = [each.estimate_degC for each in moments]
    table = np.concatenate([regressors_degC2(wanted, each, 0 * each, period_s) for each in estimates], axis=1)
    known = ~np.isnan(errors)
    constant, *weights = student_weights(errors[known], table[:, known])
    off = np.abs(errors) / np.sqrt(np.array([constant, *weights]) @ table)
    terms = tuple(term._replace(weight=weight) for term, weight in zip(wanted, weights) if weight > 0)
    return ErrorVariance(constant, terms, _symmetric(np.nanpercentile(off, LEVELS_PERCENT).tolist()))


def fit_weighted_error_variance(terms: Sequence[Term], error: Array, table: Array, weight: Array) -> ErrorVariance:
    """Error variance model of ``terms`` for errors (N,), their regressors (1 + q, N) and what each sample weighs."""
    constant, *factors = (weights := least_squares_weights(error, table, weight)).tolist()
    reach = np.abs(error) / np.sqrt(np.maximum(weights @ table, _LEAST_VARIANCE_DEGC2))
    reaches = [weighted_quantile(reach, weight, level / 100) for level in LEVELS_PERCENT]
    weighted = tuple(term._replace(weight=factor) for term, factor in zip(terms, factors))
    return ErrorVariance(max(constant, _LEAST_VARIANCE_DEGC2), weighted, _symmetric(reaches))


def _symmetric(reaches: Sequence[float]) -> Quantiles:
    return {level: (-reach, reach) for level, reach in zip(LEVELS_PERCENT, reaches)}


def half_widths(model: ErrorVariance, estimates: Iterable[tuple[Array, Array]], period_s: float) -> dict[str, float]:
    """Half the width of the 90 % interval in degC, by the percentage of samples over which it is narrower.

    ``estimates`` are pairs as :func:`sigma_degC` takes them.
    """
    sigmas = [sigma_degC(model, *each, period_s) for each in estimates]
    halves = np.percentile(np.concatenate(sigmas) * model.quantiles[_INTERVAL][1], _SHOWN_PERCENT)
    return {str(percent): float(half) for percent, half in zip(_SHOWN_PERCENT, halves)}


def sigma_degC(model: ErrorVariance, ambient_degC: Array, apart_degC: Array, period_s: float) -> Array:
    """Standard deviation (N,) of the error of the published estimate ``ambient_degC`` (N,).

    ``apart_degC`` (N,) is the main estimate minus the secondary one, limited to the threshold; zero without one.
    """
    weights = np.array([model.constant_degC2, *(term.weight for term in model.terms)])
    return np.sqrt(weights @ regressors_degC2(model.terms, ambient_degC, apart_degC, period_s))


def regressors_degC2(terms: Sequence[Term], ambient_degC: Array, apart_degC: Array, period_s: float) -> Array:
    """The constant's regressor and each term's, before their weights, (1 + q, N)."""
    rows = [_regressor_degC2(term, ambient_degC, apart_degC, period_s) for term in terms]
    return np.vstack([np.ones_like(ambient_degC), *rows])


def student_weights(errors: Array, table: Array) -> list[float]:
    """The weights w, none negative, of the variance w' ``table`` (q, N) that makes ``errors`` (N,) likeliest."""
    size = table.mean(axis=1)
    size[size == 0] = 1.0
    shares, whole = table / size[:, None], float(np.mean(errors**2))

    def negative_likelihood(logs: Array) -> tuple[float, Array]:
        weights = np.exp(logs)
        variance = weights @ shares
        ratio = errors**2 / (_FREEDOM * variance)
        slope = (1 - (_FREEDOM + 1) * ratio / (1 + ratio)) / variance
        value = np.mean(np.log(variance) + (_FREEDOM + 1) * np.log1p(ratio))
        return float(value), (shares * slope).mean(axis=1) * weights

    low, high = np.log(whole * _LEAST), np.log(whole * 10)
    start, bounds = np.full(len(table), np.log(whole / len(table))), [(low, high)] * len(table)
    likeliest = np.exp(minimize(negative_likelihood, start, jac=True, method="L-BFGS-B", bounds=bounds).x)
    # without a constant, an estimate that does not change would be called exact
    weights = np.where(likeliest > 100 * _LEAST * whole, likeliest, 0.0) / size
    return [max(float(weights[0]), whole * _LEAST), *weights[1:].tolist()]


def least_squares_weights(error: Array, table: Array, weight: Array) -> Array:
    """The weights, none negative, with which ``table`` (q, N) makes the variance of ``error`` (N,)."""
    variance = np.full(len(error), np.average(error**2, weights=weight))
    for _ in range(_ROUNDS):
        row = np.sqrt(weight) / variance
        weights, _ = nnls((table * row).T, error**2 * row)
        variance = np.maximum(weights @ table, _LEAST_VARIANCE_DEGC2)
    return np.asarray(weights)


def weighted_quantile(values: Array, weight: Array, share: float) -> float:
    """The value below which ``share`` of the weight lies."""
    order = np.argsort(values)
    return float(np.interp(share, np.cumsum(weight[order]) / weight.sum(), values[order]))


def _regressor_degC2(term: Term, ambient_degC: Array, apart_degC: Array, period_s: float) -> Array:
    off = apart_degC
    if term.of == "movement":
        off = ambient_degC - low_pass(ambient_degC, term.lag_s, period_s, ambient_degC[0])
    return low_pass(off**2, term.lag_s, period_s, off[0] ** 2)
