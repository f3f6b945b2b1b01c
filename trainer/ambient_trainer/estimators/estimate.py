"""Estimates over a whole trace: vectorised where it has no gap, by the device's own tracker where it has."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_model.model import Discrete, Estimator, Input, Matrix
from ambient_model.trace import split_column
from ambient_model.tracking import Tracker
from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.lti import Hold, StateSpace, discretised, equilibrium, response_degC


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


class Blended(NamedTuple):
    """The main estimate blended with a secondary one; arrays of shape (N,)."""

    ambient_degC: Array
    weight: Array
    """Of the secondary estimate, 0 to 1."""
    apart_degC: Array
    """The main estimate minus the secondary, clipped to the threshold: a regressor of the error variance."""


def blended(main_degC: Array, secondary_degC: Array, threshold_degC: float) -> Blended:
    """The rule of ``ambient_model.blend`` over arrays."""
    apart = main_degC - secondary_degC
    weight = np.clip((np.abs(apart) - threshold_degC) / threshold_degC, 0.0, 1.0)
    return Blended(main_degC - weight * apart, weight, np.clip(apart, -threshold_degC, threshold_degC))


def _tracked(system: StateSpace, hold: Hold, columns: Sequence[str], trace: Trace, period_s: float) -> Array:
    discrete, initial = recursion(system, period_s, hold), equilibrium(system)
    inputs = tuple(Input(*split_column(name), split_column(name)[0], -math.inf, math.inf) for name in columns)
    names = tuple(f"x{index}" for index in range(len(initial)))
    estimator = Estimator(inputs, names, (discrete,), float(system.offset[0]), matrix(initial), {90: (0.0, 0.0)})
    tracker = Tracker(estimator, discrete)
    rows = zip(*(trace.columns[name].tolist() for name in columns))
    readings = ([None if value != value else value for value in row] for row in rows)
    estimates = [tracker.update(now_s, row).ambient_degC for now_s, row in zip(trace.time_s.tolist(), readings)]
    # None becomes NaN
    return np.array(estimates, dtype=np.float64)


def matrix(values: NDArray[np.float64]) -> Matrix:
    """An array as a model file's rows."""
    return tuple(tuple(row) for row in values.tolist())


def recursion(system: StateSpace, period_s: float, hold: Hold) -> Discrete:
    """The recursion of the first output of continuous ``system``, as a model file has it."""
    found = discretised(system, period_s, hold)
    return Discrete(period_s, *map(matrix, (found.A, found.B, found.C[:1], found.D[:1])))
