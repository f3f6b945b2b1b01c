"""What a system says over a whole trace, as the device would say it sample by sample, at the speed of arrays.

Over a trace without gaps the recursion x[k+1] = A x[k] + b[k] is summed by doubling (Hillis and Steele 1986): after
the step of length s, x[k] holds its last 2 s terms. Where something is missing, the device's own tracker runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_model.model import Discrete, Estimator, Input, Matrix
from ambient_model.trace import split_column
from ambient_model.tracking import Tracker
from ambient_trainer.circuits.assemble import StateSpace
from ambient_trainer.circuits.circuit import Hold
from ambient_trainer.identify.discretise import discretised
from ambient_trainer.traces.grid import sampling_period_s
from ambient_trainer.traces.trace import Array, Trace

_DIVERGED_DEGC = 1e9


def estimate_degC(system: StateSpace, hold: Hold, inputs: Sequence[str], trace: Trace) -> Array:
    """The first output of continuous ``system`` over ``trace``, shape (n,), from equilibrium with the first sample.

    ``inputs`` are trace columns; every reading counts, however far off. NaN where the device has no estimate, and
    where an unstable system has grown beyond 1e9 degC. Raises :class:`Refused` for a missing column.
    """
    u = np.vstack([trace.column(name) for name in inputs])
    period_s = sampling_period_s(trace.time_s)
    steps = np.floor((trace.time_s - trace.time_s[0]) / period_s + 0.5)
    if np.isnan(u).any() or not np.array_equal(steps, np.arange(len(steps))):
        return _tracked(system, hold, inputs, trace, period_s)
    return response_degC(system, hold, u, period_s)


def response_degC(system: StateSpace, hold: Hold, u: Array, period_s: float) -> Array:
    """The same over uniform inputs ``u`` (m, N) without gaps: shape (N,)."""
    discrete = discretised(system, period_s, hold)
    with np.errstate(over="ignore", invalid="ignore"):
        x = states(discrete.A, discrete.B @ u, _initial(system) @ u[:, 0])
        y = (discrete.C @ x + discrete.D @ u)[0] + discrete.offset[0]
        return np.where(np.abs(y) < _DIVERGED_DEGC, y, np.nan)


def states(A: Array, drive: Array, start: Array) -> Array:
    """x (n, N) of x[k+1] = A x[k] + drive[k] with x[0] = start; ``drive`` (n, N), of which the last is not used."""
    x: Array = np.concatenate([start[:, None], drive[:, :-1]], axis=1)
    power, stride = A, 1
    while len(A) and stride < x.shape[1]:
        x[:, stride:] += power @ x[:, :-stride]
        power, stride = power @ power, 2 * stride
    return x


def _tracked(system: StateSpace, hold: Hold, columns: Sequence[str], trace: Trace, period_s: float) -> Array:
    found, initial = discretised(system, period_s, hold), _initial(system)
    discrete = Discrete(period_s, *(_matrix(each) for each in (found.A, found.B, found.C[:1], found.D[:1])))
    inputs = tuple(Input(*split_column(name), split_column(name)[0], -math.inf, math.inf) for name in columns)
    names = tuple(f"x{index}" for index in range(len(initial)))
    estimator = Estimator(inputs, names, (discrete,), float(found.offset[0]), _matrix(initial), {90: (0.0, 0.0)})
    tracker = Tracker(estimator, discrete)
    rows = zip(*(trace.columns[name].tolist() for name in columns))
    readings = ([None if value != value else value for value in row] for row in rows)
    said = [tracker.update(now_s, row).ambient_degC for now_s, row in zip(trace.time_s.tolist(), readings)]
    # None becomes NaN
    return np.array(said, dtype=np.float64)


def _initial(system: StateSpace) -> Array:
    """X0: thermal equilibrium with inputs u is X0 u."""
    return np.asarray(-np.linalg.solve(system.A, system.B), dtype=np.float64)


def _matrix(values: NDArray[np.float64]) -> Matrix:
    return tuple(tuple(row) for row in values.tolist())
