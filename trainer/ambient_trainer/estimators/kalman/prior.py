"""The prior of an observer: time constants from the sensors' own lags, noise from a coarse grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimators.kalman.observer_structure import estimate_of
from ambient_trainer.estimators.kalman.random_walk import RandomWalkAmbient
from ambient_trainer.lti.modes import one_pole
from ambient_trainer.lti.riccati import Unsettled

Array = NDArray[np.float64]

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
    tau = np.array([_lag_s(segments, index) for index in range(circuit.count)])
    period_s = segments[0].period_s
    speeds = np.geomspace(2 / period_s, 1 / max(tau.max(), 4 * period_s), _SPEEDS)
    found = [_theta(circuit, tau, speed, share) for speed in speeds for share in _WALKS]
    return min(found, key=_square_left(circuit, segments))


def _theta(circuit: RandomWalkAmbient, tau: Array, speed: float, share: float) -> Array:
    """With one sensor the filter's poles have the product walk/(tau r): ``speed`` squared."""
    n, edges = circuit.count, len(circuit.pairs)
    groups = (
        tau,
        np.ones(n - 1),
        np.full(edges, _EXCHANGE / np.median(tau)),
        np.full(n, share * circuit.walk),
        circuit.walk / (tau * speed**2),
    )
    return np.log(np.concatenate(groups))


def _square_left(circuit: RandomWalkAmbient, segments: Sequence[Segment]) -> Callable[[Array], float]:
    def square(theta: Array) -> float:
        try:
            found = circuit.filter(theta)
        except Unsettled:
            return math.inf
        errors = np.concatenate([each.outputs[0] - estimate_of(found, each) for each in segments])
        return float(np.nanvar(errors))

    return square


def _lag_s(segments: Sequence[Segment], index: int) -> float:
    """The time constant of the first-order lag behind the reference that comes nearest to the sensor."""
    period_s = segments[0].period_s
    longest_s = max(each.inputs.shape[1] for each in segments) * period_s / 4
    lags = np.geomspace(period_s, max(longest_s, 2 * period_s), _LAGS)
    return float(min(lags, key=lambda lag_s: _far_from_lag(segments, index, lag_s)))


def _far_from_lag(segments: Sequence[Segment], index: int, lag_s: float) -> float:
    far = []
    for each in segments:
        stay = math.exp(-each.period_s / lag_s)
        reference = _without_gaps(each.outputs[0])
        lagging = one_pole(stay, (1 - stay) * reference[None], reference[:1])[0]
        far.append(each.inputs[index] - lagging)
    return float(np.var(np.concatenate(far)))


def _without_gaps(row: Array) -> Array:
    known = np.flatnonzero(~np.isnan(row))
    return np.interp(np.arange(len(row)), known, row[known])
