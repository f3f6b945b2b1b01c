"""Variance of the estimate's error, from low-pass filtered regressors.

    L[z][k] = L[z][k-1] + a (z[k] - L[z][k-1]),  a = 1 - exp(-T / lag),  L[z][0] = z[0]
    movement = L[(y - L[y])^2]
    guard    = L[d^2]
    sigma^2  = constant + sum of weight x term

y is the published estimate; d is the main estimate minus the secondary one, limited to plus or minus the threshold; T
is the time since the previous sample; each term has a lag of its own. The published interval is y plus sigma times the
quantiles. The model file's key of this model is ``spread``, and ``movement`` and ``guard`` are the regressors' names
there.
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
    squares = [difference_degC * difference_degC if term.of == "guard" else 0.0 for term in model.terms]
    return VarianceState((ambient_degC,) * len(model.terms), tuple(squares))


def advanced(
    model: ErrorVariance, before: VarianceState, a: tuple[float, ...], ambient_degC: float, difference_degC: float
) -> VarianceState:
    """State one sample later, with the gains ``a`` of :func:`gains`."""
    means, squares = [], []
    for term, gain, mean, square in zip(model.terms, a, before.means_degC, before.squares_degC2):
        mean += gain * (ambient_degC - mean)
        means.append(mean)
        z = difference_degC if term.of == "guard" else ambient_degC - mean
        squares.append(square + gain * (z * z - square))
    return VarianceState(tuple(means), tuple(squares))


def sigma_degC(model: ErrorVariance, state: VarianceState) -> float:
    """Standard deviation of the estimate's error."""
    variance = model.constant_degC2
    for term, square in zip(model.terms, state.squares_degC2):
        variance += term.weight * square
    return math.sqrt(variance)
