"""The baseline: the best static linear map from the sensors to the ambient, on the same samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array

STATIC_LINEAR = "static linear"
"""What a model file calls it."""


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
