"""What a model file says over whole arrays, its guard and its spread included, as the device would say it.

The rules are those of ``ambient_model.guard`` and ``ambient_model.spread``, here over arrays of samples without gaps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ambient_model.model import Estimator, Model
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.error_variance import sigma_degC
from ambient_trainer.lti.response import states


@dataclass(frozen=True)
class Observed:
    """What is said of N samples; arrays of shape (N,)."""

    ambient_degC: Array
    weight: Array
    """How much of the guard's word is in it, 0 to 1."""
    scale: Array
    """What the quantiles are times: the standard deviation in degC of a model with a spread, 1 of any other."""


def observe(model: Model, u: Array, period_s: float) -> Observed:
    """What ``model`` says to its inputs ``u`` (m, N), all there, ``period_s`` apart, which is one of its periods.

    The recursions start in equilibrium with the first sample. Ranges of inputs are not looked at.
    """
    ambient = response_of(model.main, u, period_s)
    apart, weight = np.zeros_like(ambient), np.zeros_like(ambient)
    if model.guard is not None:
        guard = response_of(model.guard.estimator, u, period_s)
        ambient, weight, apart = guarded(ambient, guard, model.guard.threshold_degC)
    if model.spread is None:
        return Observed(ambient, weight, np.ones_like(ambient))
    return Observed(ambient, weight, sigma_degC(model.spread, ambient, apart, period_s))


def response_of(estimator: Estimator, u: Array, period_s: float) -> Array:
    """The estimator's output over its inputs ``u`` (m, N) at one of its periods: shape (N,)."""
    [found] = [each for each in estimator.discrete if each.period_s == period_s]
    n, m = len(estimator.states), len(estimator.inputs)
    A, B, C, D, start = (
        np.reshape(np.array(matrix, dtype=np.float64), shape)
        for matrix, shape in zip(
            (found.A, found.B, found.C, found.D, estimator.initial), ((n, n), (n, m), (1, n), (1, m), (n, m))
        )
    )
    x = states(A, B @ u, start @ u[:, 0])
    response: Array = (C @ x + D @ u)[0] + estimator.offset
    return response


class Guarded(NamedTuple):
    """What main and guard say together; arrays of shape (N,)."""

    ambient_degC: Array
    weight: Array
    """How much of the guard's word is in it, 0 to 1."""
    apart_degC: Array
    """How far the main estimate lies above the guard's, as the spread takes it: at most the threshold either way."""


def guarded(main_degC: Array, guard_degC: Array, threshold_degC: float) -> Guarded:
    """The estimate that is published where both are there."""
    apart = main_degC - guard_degC
    weight = np.clip((np.abs(apart) - threshold_degC) / threshold_degC, 0.0, 1.0)
    return Guarded(main_degC - weight * apart, weight, np.clip(apart, -threshold_degC, threshold_degC))
