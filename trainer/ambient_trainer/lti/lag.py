"""The first-order lag 1/(tau s + 1), exact where its input runs straight between samples (first-order hold).

With a = exp(-T/tau) and g = (1 - a) tau/T,

    x[k+1] = a x[k] + (g - a) u[k] + (1 - g) u[k+1].
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array


class LagWeights(NamedTuple):
    """What the next value of a lag takes of its last one, and of the input before and now."""

    kept: Any
    before: Any
    now: Any

    def step(self, last: Any, before: Any, now: Any) -> Any:
        """The next value after ``last``, the input going from ``before`` to ``now``."""
        return self.kept * last + self.now * now + self.before * before


def lag_weights(lag_s: ArrayLike, period_s: ArrayLike) -> LagWeights:
    """Weights of the recursion of a lag of time constant tau > 0 (infinity holds the value), numbers or arrays."""
    ratio = np.asarray(period_s, dtype=float) / np.asarray(lag_s, dtype=float)
    kept = np.exp(-ratio)
    gained = np.where(ratio > 0, -np.expm1(-ratio) / np.where(ratio > 0, ratio, 1.0), 1.0)
    return LagWeights(*(each if each.shape else float(each) for each in (kept, gained - kept, 1.0 - gained)))


def low_pass(values: Array, lag_s: float, period_s: float, start: Array | float) -> Array:
    """The device's low-pass along the first axis: L[k] = L[k-1] + (1 - exp(-T/tau)) (z[k] - L[k-1]), from L = start."""
    kept = math.exp(-period_s / lag_s)
    return np.asarray(lfilter([-math.expm1(-period_s / lag_s)], [1.0, -kept], values - start, axis=0) + start)


def lagged(values: Array, lag_s: float, period_s: float) -> Array:
    """Response (..., N) of a lag to uniform samples (..., N), settled at the first of them."""
    kept, before, now = lag_weights(lag_s, period_s)
    first = values[..., :1]
    return np.asarray(lfilter([now, before], [1.0, -kept], values - first, axis=-1) + first)
