"""Linear least squares: by Gram matrices, under a linear constraint, and the baseline, the best static linear map.

By Gram matrices inner products are formed once, and weights are solved for as often as wanted.

The mean square of target - table' w is the quadratic function w' G w - 2 g' w + c of the weights, with G the inner
products of the regressors, g those with the target, and c the target's own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array

STATIC_LINEAR = "static linear"
"""What a model file calls the baseline."""
_TINY = 1e-30


class Gram(NamedTuple):
    """w' quadratic w - 2 linear' w + constant."""

    quadratic: Array
    linear: Array
    constant: float

    @staticmethod
    def of(table: Array, target: Array) -> Gram:
        """The mean square error over samples: regressors (p, N), target (N,)."""
        count = len(target)
        return Gram(table @ table.T / count, table @ target / count, float(target @ target) / count)

    @staticmethod
    def total(parts: Iterable[tuple[float, Gram]]) -> Gram:
        """The sum of the parts, each times its factor."""
        scaled = [(factor * part.quadratic, factor * part.linear, factor * part.constant) for factor, part in parts]
        return Gram(*(sum(each[1:], start=each[0]) for each in zip(*scaled)))

    def __call__(self, weights: Array) -> float:
        """The value at ``weights``."""
        return float(weights @ self.quadratic @ weights - 2 * weights @ self.linear + self.constant)

    def minimum(self, ridge: float) -> Array:
        """The weights (p,) at which it is least; the ridge is added to a unit diagonal (Marquardt 1963)."""
        size = np.sqrt(np.maximum(np.diag(self.quadratic), _TINY))
        scaled = self.quadratic / np.outer(size, size) + ridge * np.eye(len(size))
        return np.asarray(np.linalg.solve(scaled, self.linear / size) / size)


def constrained_solution(matrix: Array, side: Array, unit: Array) -> Array:
    """argmin b' G b - 2 g' b with c' b = 1, for stacks G (..., p, p) and g (..., p), c being ``unit`` (p,).

    b = G^-1 g - G^-1 c (c' G^-1 g - 1) / (c' G^-1 c).
    """
    solved = np.linalg.solve(matrix, np.stack([side, np.broadcast_to(unit, side.shape)], axis=-1))
    free, by_unit = solved[..., 0], solved[..., 1]
    beyond = (free @ unit - 1) / (by_unit @ unit)
    return np.asarray(free - by_unit * beyond[..., None])


class StaticLinear(NamedTuple):
    """ambient = gains' u + offset; ``rmse_degC`` on the samples it was fitted to."""

    gains: Array
    offset: float
    rmse_degC: float


def fit_static_linear(segments: Sequence[Segment]) -> StaticLinear:
    """The least-squares static map from the sensors to the first output over ``segments``."""
    u = np.concatenate([segment.inputs for segment in segments], axis=1)
    y = np.concatenate([segment.outputs[0] for segment in segments])
    known = ~np.isnan(y)
    table = np.column_stack([u[:, known].T, np.ones(int(known.sum()))])
    solution = np.linalg.lstsq(table, y[known], rcond=None)[0]
    errors = y[known] - table @ solution
    return StaticLinear(solution[:-1], float(solution[-1]), float(np.sqrt(np.mean(errors**2))))
