"""Error variance model: sigma^2 = constant + sum of weight x regressor, fitted to the errors of training runs.

The regressors are those of ``ambient_model.error_variance``. The weights, none negative, are those with which Student's
t distribution makes the errors most likely. Its tails are wide: a few large errors in a jump do not widen the interval
of quiet hours. Quantiles are of the errors themselves, in units of their standard deviation.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from ambient_model.model import LEVELS_PERCENT, ErrorVariance, Term
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import low_pass

_LAGS_PERIODS = (1, 3, 10, 30, 100)
"""None below a period: what such a lag lets through depends on how often a device ticks."""
_LAGS_IN_DATA = 50
_FREEDOM = 3.0
_LEAST = 1e-6
"""The share of the whole variance below which a term is none."""
_SIDES = {"guard": (-np.inf, np.inf), "guard_above": (0.0, np.inf), "guard_below": (-np.inf, 0.0)}
_SHOWN_PERCENT = (10, 50, 90, 99)


class Moment(NamedTuple):
    """An estimate without gaps and its reference, NaN where there is none: (N,) each.

    ``apart_degC`` is the main estimate minus the secondary one, limited to the threshold, zero without one; ``weight``
    is what each sample counts.
    """

    estimate_degC: Array
    reference_degC: Array
    apart_degC: Array | float = 0.0
    weight: float = 1.0


def fit_error_variance(moments: Sequence[Moment], period_s: float, terms: Sequence[Term] = ()) -> ErrorVariance:
    """Error variance model of one estimator, by default with terms of its rate of change by lags that the runs show."""
    if not terms:
        samples = max(len(each.estimate_degC) for each in moments)
        lags = [periods for periods in _LAGS_PERIODS if periods * _LAGS_IN_DATA <= samples] or [1]
        terms = [Term("movement", periods * period_s, 1.0) for periods in lags]
    errors = np.concatenate([each.reference_degC - each.estimate_degC for each in moments])
    known = ~np.isnan(errors)
    table = np.concatenate([regressors_degC2(terms, *each[::2], period_s) for each in moments], axis=1)[:, known]
    counts = np.concatenate([np.full(len(each.estimate_degC), each.weight) for each in moments])[known]
    weights = student_weights(errors[known], table, counts)
    off = np.abs(errors[known]) / np.sqrt(weights @ table)
    order = np.argsort(off)
    shares = np.cumsum(counts[order]) / counts.sum()
    reaches = np.interp(np.array(LEVELS_PERCENT) / 100, shares, off[order]).tolist()
    kept = tuple(term._replace(weight=weight) for term, weight in zip(terms, weights[1:].tolist()) if weight > 0)
    return ErrorVariance(float(weights[0]), kept, {level: (-x, x) for level, x in zip(LEVELS_PERCENT, reaches)})


def half_widths(model: ErrorVariance, moments: Iterable[Moment], period_s: float) -> dict[str, float]:
    """Half the width of the 90 % interval in degC, by the percentage of samples over which it is narrower."""
    sigmas = [sigma_degC(model, *each[::2], period_s) for each in moments]
    halves = np.percentile(np.concatenate(sigmas) * model.quantiles[90][1], _SHOWN_PERCENT)
    return {str(percent): float(half) for percent, half in zip(_SHOWN_PERCENT, halves)}


def sigma_degC(model: ErrorVariance, ambient_degC: Array, apart_degC: Array | float, period_s: float) -> Array:
    """Standard deviation (N,) of the error of the published estimate ``ambient_degC`` (N,); see :class:`Moment`."""
    weights = np.array([model.constant_degC2, *(term.weight for term in model.terms)])
    variance = weights @ regressors_degC2(model.terms, ambient_degC, apart_degC, period_s)
    if model.beyond is not None:
        within = np.clip(ambient_degC, model.beyond.low_degC, model.beyond.high_degC)
        variance = variance + model.beyond.weight * (ambient_degC - within) ** 2
    return np.asarray(np.sqrt(variance))


def regressors_degC2(terms: Sequence[Term], ambient_degC: Array, apart_degC: Array | float, period_s: float) -> Array:
    """The constant's regressor and each term's, before their weights, (1 + q, N)."""
    rows = [np.ones_like(ambient_degC)]
    for term in terms:
        off = np.clip(apart_degC + 0 * ambient_degC, *_SIDES.get(term.of, (0.0, 0.0)))
        if term.of == "movement":
            off = ambient_degC - low_pass(ambient_degC, term.lag_s, period_s, ambient_degC[0])
        rows.append(low_pass(off**2, term.lag_s, period_s, off[0] ** 2))
    return np.vstack(rows)


def student_weights(errors: Array, table: Array, counts: Array) -> Array:
    """The weights w, none negative, of the variance w' ``table`` (q, N) that makes ``errors`` (N,) likeliest.

    Each error counts as so many.
    """
    shares = counts / counts.sum()
    size = table @ shares
    unseen, size = size == 0, np.where(size == 0, 1.0, size)
    scaled, whole = table / size[:, None], float(errors**2 @ shares)

    def negative_likelihood(logs: Array) -> tuple[float, Array]:
        weights = np.exp(logs)
        variance = weights @ scaled
        ratio = errors**2 / (_FREEDOM * variance)
        slope = (1 - (_FREEDOM + 1) * ratio / (1 + ratio)) / variance
        value = (np.log(variance) + (_FREEDOM + 1) * np.log1p(ratio)) @ shares
        return float(value), scaled @ (slope * shares) * weights

    start, bounds = np.full(len(table), np.log(whole / len(table))), [np.log([whole * _LEAST, whole * 10])] * len(table)
    likeliest = np.exp(minimize(negative_likelihood, start, jac=True, method="L-BFGS-B", bounds=bounds).x)
    # without a constant, an estimate that does not change would be called exact
    weights = np.where(likeliest > 100 * _LEAST * whole, likeliest, 0.0) / size
    weights[0] = max(weights[0], whole * _LEAST)
    weights[unseen] = weights[1:][~unseen[1:]].max(initial=0.0)  # a side on which the estimates never were is no better
    return np.asarray(weights)
