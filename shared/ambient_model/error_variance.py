"""Variance of the estimate's error, from low-pass filtered regressors.

    L[z][k] = L[z][k-1] + a (z[k] - L[z][k-1]),  a = 1 - exp(-T / lag),  L[z][0] = z[0]
    movement = L[(y - L[y])^2]
    guard    = L[d^2],  guard_above = L[max(d, 0)^2],  guard_below = L[min(d, 0)^2]
    beyond   = max(y - high, low - y, 0)
    sigma^2  = constant + sum of weight x term + weight x beyond^2

y is the published estimate; d is the main estimate minus the secondary one, limited to plus or minus the threshold; T
is the time since the previous sample; each term has a lag of its own; low to high is what training has estimated.
Unmeasured heat of one kind drives the two estimators apart to one side, of another kind to the other, with errors of
another size. The published interval is y plus sigma times the quantiles. The model file's key of this model is
``spread``, and ``movement``, ``guard``, ``guard_above`` and ``guard_below`` are the regressors' names there.
"""

import math
from typing import NamedTuple

from ambient_model.model import ErrorVariance


class VarianceState(NamedTuple):
    """The low-pass filters' outputs after a sample, one per term."""

    means_degC: tuple[float, ...]
    """L[y] of each term."""
    squares_degC2: tuple[float, ...]
    """Each term."""


def gains(model: ErrorVariance, passed_s: float) -> tuple[float, ...]:
    """Gain a of each term, ``passed_s`` after the previous sample."""
    return tuple([-math.expm1(-passed_s / term.lag_s) for term in model.terms])


def initial_state(model: ErrorVariance, ambient_degC: float, difference_degC: float) -> VarianceState:
    """State at the first sample: steady, so that only the difference of the two estimators counts."""
    apart = [0.0 if term.of == "movement" else _side(term.of, difference_degC) for term in model.terms]
    return VarianceState((ambient_degC,) * len(model.terms), tuple([z * z for z in apart]))


def advanced(
    model: ErrorVariance, before: VarianceState, a: tuple[float, ...], ambient_degC: float, difference_degC: float
) -> VarianceState:
    """State one sample later, with the gains ``a`` of :func:`gains`."""
    means, squares = [], []
    for term, gain, mean, square in zip(model.terms, a, before.means_degC, before.squares_degC2):
        mean += gain * (ambient_degC - mean)
        means.append(mean)
        z = ambient_degC - mean if term.of == "movement" else _side(term.of, difference_degC)
        squares.append(square + gain * (z * z - square))
    return VarianceState(tuple(means), tuple(squares))


def sigma_degC(model: ErrorVariance, state: VarianceState, beyond_degC: float) -> float:
    """Standard deviation of the estimate's error, so far outside of what training has seen."""
    variance = model.constant_degC2
    for term, square in zip(model.terms, state.squares_degC2):
        variance += term.weight * square
    if model.beyond is not None:
        variance += model.beyond.weight * (beyond_degC * beyond_degC)
    return math.sqrt(variance)


def beyond_degC(model: ErrorVariance, ambient_degC: float) -> float:
    """How far an estimate lies outside of what training has seen; 0 where the file does not say."""
    if model.beyond is None:
        return 0.0
    return max(ambient_degC - model.beyond.high_degC, model.beyond.low_degC - ambient_degC, 0.0)


def _side(of: str, difference_degC: float) -> float:
    """What of the difference the regressor of that name is made of."""
    if of == "guard":
        return difference_degC
    return max(difference_degC, 0.0) if of == "guard_above" else min(difference_degC, 0.0)
