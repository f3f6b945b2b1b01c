"""How wrong the estimate is to be thought of grows with its unrest: the rule for its standard deviation.

    L[z][k] = L[z][k-1] + a (z[k] - L[z][k-1]),  a = 1 - exp(-T / lag),  L[z][0] = z[0]
    movement = L[(y - L[y])^2]
    guard    = L[d^2]
    sigma^2  = constant + sum of weight x term

y is the estimate that is published, d the main one minus the guard's, but at most the guard's threshold either way, T
the time since the sample before, each term has a lag of its own. The published interval lies sigma times the quantiles
around y.
"""

import math
from typing import NamedTuple

from ambient_model.model import Spread


class Unrest(NamedTuple):
    """What the terms rest on after a sample, the low-passes term by term."""

    means_degC: tuple[float, ...]
    """L[y] of each term."""
    squares_degC2: tuple[float, ...]
    """Each term."""


def gains(spread: Spread, passed_s: float) -> tuple[float, ...]:
    """a of each term, ``passed_s`` after the sample before."""
    return tuple([-math.expm1(-passed_s / term.lag_s) for term in spread.terms])


def at_rest(spread: Spread, ambient_degC: float, apart_degC: float) -> Unrest:
    """The unrest at the first sample: that of the guard alone."""
    squares = [apart_degC * apart_degC if term.of == "guard" else 0.0 for term in spread.terms]
    return Unrest((ambient_degC,) * len(spread.terms), tuple(squares))


def followed(spread: Spread, before: Unrest, a: tuple[float, ...], ambient_degC: float, apart_degC: float) -> Unrest:
    """The unrest one sample later, with ``a`` of :func:`gains`."""
    means, squares = [], []
    for term, gain, mean, square in zip(spread.terms, a, before.means_degC, before.squares_degC2):
        mean += gain * (ambient_degC - mean)
        means.append(mean)
        z = apart_degC if term.of == "guard" else ambient_degC - mean
        squares.append(square + gain * (z * z - square))
    return Unrest(tuple(means), tuple(squares))


def sigma_degC(spread: Spread, unrest: Unrest) -> float:
    """The standard deviation of the error, as it is to be thought of."""
    variance = spread.constant_degC2
    for term, square in zip(spread.terms, unrest.squares_degC2):
        variance += term.weight * square
    return math.sqrt(variance)
