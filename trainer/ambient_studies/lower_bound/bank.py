"""The richest linear filter that needs no search: least squares over every input and many low-passes of each.

    y[k] = offset + sum_i (w_i0 u_i[k] + sum_j w_ij l_ij[k])
    l_ij = (1 - a_j)/(z - a_j) u_i,    a_j = exp(-T / tau_j)

With time constants evenly spaced in logarithm it approaches any causal filter of decaying memory. The ridge penalty,
against fitting the noise, is selected by leaving out one training run at a time.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.lti import low_pass

_FASTEST_S, _SLOWEST_S = 2.0, 8000.0
_RIDGES = tuple(10.0**exponent for exponent in range(-10, -1))


class Gram(NamedTuple):
    """The mean square of target - table' w as a function of the weights: w' quadratic w - 2 linear' w + constant."""

    quadratic: Array
    linear: Array
    constant: float


def gram(trace: Trace, columns: Sequence[str], lags: int) -> Gram:
    """The Gram of a run without gaps over ``columns``, ``lags`` low-passes each, and the offset."""
    u = np.vstack([trace.column(name) for name in columns])
    period_s = sampling_period_s(trace.time_s)
    before = np.concatenate([u[:, :1], u[:, :-1]], axis=1).T
    lags_s = np.geomspace(_FASTEST_S, _SLOWEST_S, lags).tolist()
    lows = [low_pass(before, lag_s, period_s, u[:, 0]).T for lag_s in lags_s]
    S, target = np.concatenate([u, *lows, np.ones((1, u.shape[1]))]), trace.reference
    return Gram(S @ S.T / len(target), S @ target / len(target), float(target @ target) / len(target))


def fitted(runs: Sequence[Gram]) -> Array:
    """Ridge-regression weights (p,), with the penalty under which each run is predicted best from the others."""
    if len(runs) == 1:
        return _solved(runs, _RIDGES[len(_RIDGES) // 2])

    def left_out(ridge: float) -> float:
        others = [[*runs[:index], *runs[index + 1 :]] for index in range(len(runs))]
        return sum(_mean_square(_solved(rest, ridge), run) for rest, run in zip(others, runs))

    return _solved(runs, min(_RIDGES, key=left_out))


def rmse_degC(weights: Array, runs: Sequence[Gram]) -> float:
    """The RMSE over all ``runs``, each with the same weight."""
    return math.sqrt(sum(_mean_square(weights, run) for run in runs) / len(runs))


def _mean_square(weights: Array, run: Gram) -> float:
    """In degC^2; what rounding makes negative is zero."""
    return max(float(weights @ run.quadratic @ weights - 2 * weights @ run.linear + run.constant), 0.0)


def _solved(runs: Sequence[Gram], ridge: float) -> Array:
    """The weights of least mean square over ``runs``; the ridge is added to a unit diagonal (Marquardt 1963)."""
    quadratic, linear = np.sum([run.quadratic for run in runs], axis=0), np.sum([run.linear for run in runs], axis=0)
    size = np.sqrt(np.maximum(np.diag(quadratic), 1e-30))
    return np.asarray(
        np.linalg.solve(quadratic / np.outer(size, size) + ridge * np.eye(len(size)), linear / size) / size
    )
