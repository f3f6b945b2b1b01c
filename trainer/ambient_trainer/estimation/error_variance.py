"""How wrong an observer's estimate is to be thought: a variance that grows with the estimate's own movement.

The weights, none negative, are those with which Student's t distribution makes the training errors most likely. Its
tails are wide: a few large errors in a jump do not widen what is said of quiet hours. Levels come from the errors
themselves, in units of their standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from ambient_model.model import LEVELS_PERCENT, ErrorVariance, Term

Array = NDArray[np.float64]

_LAGS_PERIODS = (1, 3, 10, 30, 100)
"""None below a period: what such a lag lets through depends on how often a device ticks."""
_LAGS_IN_DATA = 50
_FREEDOM = 3.0
_LEAST = 1e-6
"""The share of the whole variance below which a term is none."""
_INTERVAL = 90
_SHOWN_PERCENT = (10, 50, 90, 99)


class Moment(NamedTuple):
    """An estimate without gaps and its reference, NaN where there is none: (N,) each."""

    estimate_degC: Array
    reference_degC: Array


def fit_spread(moments: Sequence[Moment], period_s: float) -> ErrorVariance:
    """The spread that the errors call for."""
    samples = max(len(each.estimate_degC) for each in moments)
    lags = [periods for periods in _LAGS_PERIODS if periods * _LAGS_IN_DATA <= samples] or [1]
    wanted = tuple(Term("movement", periods * period_s, 1.0) for periods in lags)
    errors = np.concatenate([each.reference_degC - each.estimate_degC for each in moments])
    table = np.concatenate([_unrest(wanted, each.estimate_degC, period_s) for each in moments], axis=1)
    known = ~np.isnan(errors)
    constant, *weights = _likeliest(errors[known], table[:, known])
    terms = tuple(term._replace(weight=weight) for term, weight in zip(wanted, weights) if weight > 0)
    unscaled = ErrorVariance(constant, terms, {})
    off = np.concatenate([_sigmas_off(unscaled, each, period_s) for each in moments])
    bands = {level: float(np.nanpercentile(off, level)) for level in LEVELS_PERCENT}
    return unscaled._replace(quantiles={level: (-reach, reach) for level, reach in bands.items()})


def half_widths(spread: ErrorVariance, moments: Sequence[Moment], period_s: float) -> dict[str, float]:
    """Half the width of the 90 % interval in degC, by the percentage of samples over which it is narrower."""
    sigmas = np.concatenate([_sigma(spread, each.estimate_degC, period_s) for each in moments])
    halves = np.percentile(sigmas * spread.quantiles[_INTERVAL][1], _SHOWN_PERCENT)
    return {str(percent): float(half) for percent, half in zip(_SHOWN_PERCENT, halves)}


def _likeliest(errors: Array, table: Array) -> list[float]:
    """The weights w, none negative, of the variance w' ``table`` (q, N) that makes ``errors`` (N,) likeliest."""
    size = table.mean(axis=1)
    size[size == 0] = 1.0
    shares, whole = table / size[:, None], float(np.mean(errors**2))

    def cost(logs: Array) -> tuple[float, Array]:
        weights = np.exp(logs)
        variance = weights @ shares
        excess = errors**2 / (_FREEDOM * variance)
        slope = (1 - (_FREEDOM + 1) * excess / (1 + excess)) / variance
        value = np.mean(np.log(variance) + (_FREEDOM + 1) * np.log1p(excess))
        return float(value), (shares * slope).mean(axis=1) * weights

    low, high = np.log(whole * _LEAST), np.log(whole * 10)
    start = np.full(len(table), np.log(whole / len(table)))
    found = np.exp(minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(low, high)] * len(table)).x)
    # a constant there must be: with none, an estimate that stands still would be called exact
    weights = np.where(found > 100 * _LEAST * whole, found, 0.0) / size
    return [max(float(weights[0]), whole * _LEAST), *weights[1:].tolist()]


def _unrest(terms: Sequence[Term], estimate: Array, period_s: float) -> Array:
    rows = [unrest_degC2(term, estimate, np.zeros_like(estimate), period_s) for term in terms]
    return np.vstack([np.ones_like(estimate), *rows])


def _sigmas_off(spread: ErrorVariance, moment: Moment, period_s: float) -> Array:
    return np.abs(moment.reference_degC - moment.estimate_degC) / _sigma(spread, moment.estimate_degC, period_s)


def _sigma(spread: ErrorVariance, estimate: Array, period_s: float) -> Array:
    return sigma_degC(spread, estimate, np.zeros_like(estimate), period_s)


def sigma_degC(spread: ErrorVariance, ambient_degC: Array, apart_degC: Array, period_s: float) -> Array:
    """The standard deviation that ``spread`` gives the published estimate, the main one being ``apart_degC`` off the
    guard's.
    """
    variance = np.full_like(ambient_degC, spread.constant_degC2)
    for term in spread.terms:
        variance += term.weight * unrest_degC2(term, ambient_degC, apart_degC, period_s)
    return np.sqrt(variance)


def unrest_degC2(term: Term, ambient_degC: Array, apart_degC: Array, period_s: float) -> Array:
    """One term of the spread, before its weight."""
    if term.of == "movement":
        squares = (ambient_degC - _low_pass(ambient_degC, term.lag_s, period_s)) ** 2
    else:
        squares = apart_degC**2
    return _low_pass(squares, term.lag_s, period_s)


def _low_pass(values: Array, lag_s: float, period_s: float) -> Array:
    """L[k] = L[k-1] + a (z[k] - L[k-1]), L[0] = z[0]."""
    gain, kept = -np.expm1(-period_s / lag_s), np.exp(-period_s / lag_s)
    passed, _ = lfilter([gain], [1.0, -kept], values, zi=[kept * values[0]])
    return np.asarray(passed, dtype=np.float64)
