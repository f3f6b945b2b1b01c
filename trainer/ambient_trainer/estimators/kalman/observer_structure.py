"""The observer as a structure for the search: theta is of its circuit and noise, an offset is solved for.

The prior has time constants from the sensors' own lags, and noise from a coarse grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.structure import Structure, Unknowns
from ambient_trainer.estimators.kalman.random_walk import RandomWalkAmbient
from ambient_trainer.lti.lag import one_pole
from ambient_trainer.lti.response import response, response_degC, response_slopes

_REACH = 8.0
"""How far theta may leave its prior: a factor of 3000."""
_PENALTY = 3e-4
"""Of an e-fold from the prior, as a share of the reference's norm: just enough to hold what the data leave open."""
_SCATTER = 0.15


class ObserverStructure(Structure):
    """The observer over segments; ``start`` (P,) is the prior of its theta."""

    def __init__(self, circuit: RandomWalkAmbient, start: Array, segments: Sequence[Segment]) -> None:
        self.circuit = circuit
        self.segments = segments
        self.search = Unknowns(circuit.names, start, start - _REACH, start + _REACH)
        self.linear = Unknowns(("offset",), np.zeros(1), np.full(1, -np.inf), np.full(1, np.inf))

    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """The estimate without its offset, and one; zero where no filter settles, which loses to any other."""
        segment = self.segments[index]
        one = np.ones((1, 1, segment.inputs.shape[1]))
        try:
            estimate = response(self.circuit.filter(theta), "first-order", segment.inputs, segment.period_s)
        except ValueError:
            return 0 * one[0], one
        return np.nan_to_num(estimate), one

    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """The estimate's derivatives in theta, (P, 1, N)."""
        segment = self.segments[index]
        try:
            value, by = self.circuit.filter(theta), self.circuit.slopes(theta)
        except ValueError:
            return np.zeros((len(theta), 1, segment.inputs.shape[1]))
        return np.nan_to_num(response_slopes(value, by, "first-order", segment.inputs, segment.period_s))

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """The penalty on the distance from the prior, which holds what the data leave open."""
        return _PENALTY * (theta - self.search.initial), _PENALTY * np.eye(len(theta))

    def random_start(self, random: np.random.Generator) -> Array:
        """Near the prior: far from it lie poor optima, and filters that weigh no sensor."""
        return self.search.initial + _SCATTER * random.standard_normal(len(self.search.initial))


_LAGS = 24
_SPEEDS = 7
_WALKS = (0.01, 0.1, 1.0)
"""The nodes' walks as shares of the ambient's."""
_EXCHANGE = 0.1
"""Conductance between nodes as a share of that to the ambient."""


def walk_of(segments: Sequence[Segment]) -> float:
    """By how much the reference walks, in K/sqrt(s)."""
    squares, lasted_s = 0.0, 0.0
    for each in segments:
        known = np.flatnonzero(~np.isnan(each.outputs[0]))
        squares += float(np.sum(np.diff(each.outputs[0, known]) ** 2))
        lasted_s += float(np.ptp(known)) * each.period_s if len(known) else 0.0
    return math.sqrt(squares / lasted_s)


def prior_theta(circuit: RandomWalkAmbient, segments: Sequence[Segment]) -> Array:
    """A theta to start from: the best of a coarse grid over how fast the filter is and how much the nodes walk."""
    n, edges, period_s = circuit.count, len(circuit.pairs), segments[0].period_s
    tau = np.array([_lag_s(segments, index) for index in range(n)])

    def theta(speed: float, share: float) -> Array:
        """With one sensor the filter's poles have the product walk/(tau r): ``speed`` squared."""
        exchange, walks = np.full(edges, _EXCHANGE / np.median(tau)), np.full(n, share * circuit.walk)
        return np.log(np.concatenate([tau, np.ones(n - 1), exchange, walks, circuit.walk / (tau * speed**2)]))

    def square(theta: Array) -> float:
        try:
            found = circuit.filter(theta)
        except ValueError:
            return math.inf
        estimates = [response_degC(found, "first-order", each.inputs, period_s) for each in segments]
        return float(np.nanvar(np.concatenate([each.outputs[0] - y for each, y in zip(segments, estimates)])))

    speeds = np.geomspace(2 / period_s, 1 / max(tau.max(), 4 * period_s), _SPEEDS)
    return min((theta(speed, share) for speed in speeds for share in _WALKS), key=square)


def _lag_s(segments: Sequence[Segment], index: int) -> float:
    """The time constant of the first-order lag behind the reference that comes nearest to the sensor."""
    period_s = segments[0].period_s
    longest_s = max(each.inputs.shape[1] for each in segments) * period_s / 4
    filled = [pd.Series(each.outputs[0]).interpolate(limit_direction="both").to_numpy() for each in segments]

    def far(lag_s: float) -> float:
        stay = math.exp(-period_s / lag_s)
        lagging = [one_pole(stay, (1 - stay) * reference[None], reference[:1])[0] for reference in filled]
        return float(np.var(np.concatenate([each.inputs[index] - lag for each, lag in zip(segments, lagging)])))

    return float(min(np.geomspace(period_s, max(longest_s, 2 * period_s), _LAGS), key=far))
