"""The observer as a structure for the search: theta is of its circuit and noise, an offset is solved for.

The signals are the estimate, one, and the estimate's slope in each of theta. With xi and upsilon what state and inputs
have moved since the start, in equilibrium,

    dy = d(D + C (I - A)^-1 B) u[0] + dC xi + dD upsilon + C dxi,    dxi[k+1] = A dxi[k] + dA xi[k] + dB upsilon[k].

C dxi needs no run per theta: it is a combination of what C x makes of each of xi and upsilon. The prior has time
constants from the sensors' own lags, and noise from a coarse grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.structure import Expansion, Unknowns
from ambient_trainer.estimators.kalman.random_walk import Filter, RandomWalkAmbient
from ambient_trainer.lti.discretise import discretised_slopes, first_order_hold
from ambient_trainer.lti.modes import one_pole
from ambient_trainer.lti.response import responses_of_output, states_from_rest
from ambient_trainer.lti.riccati import Unsettled
from ambient_trainer.lti.statespace import StateSpace

Array = NDArray[np.float64]

_REACH = 8.0
"""How far theta may leave its prior: a factor of 3000."""
_PENALTY = 3e-4
"""Of an e-fold from the prior, as a share of the reference's norm: just enough to hold what the data leave open."""
_SCATTER = 0.15


class ObserverStructure:
    """The observer over segments; ``start`` (P,) is the prior of its theta."""

    def __init__(self, circuit: RandomWalkAmbient, start: Array, segments: Sequence[Segment]) -> None:
        self.circuit = circuit
        self.segments = segments
        self.search = Unknowns(circuit.names, start, start - _REACH, start + _REACH)
        self.linear = Unknowns(("offset",), np.zeros(1), np.full(1, -np.inf), np.full(1, np.inf))

    def signals(self, theta: Array, index: int) -> Array:
        """The estimate without its offset, one, and the estimate's slopes (2 + P, N)."""
        segment = self.segments[index]
        zero = np.zeros((2 + len(theta), segment.inputs.shape[1]))
        zero[1] = 1.0
        try:
            value, slopes = self.circuit.filter_and_slopes(theta)
        except Unsettled:  # far from the prior: an estimate of zero loses to any other
            return zero
        found = _signals(*_sampled(value, slopes, segment.period_s), segment.inputs)
        return found if np.isfinite(found).all() else zero

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """The signals themselves."""
        count = len(theta)
        rows = np.eye(2 + count)
        return Expansion(rows[:1], rows[None, :, 1:2], rows[2:, None], np.zeros((count, 1, 2 + count, 1)))

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """The penalty on the distance from the prior, which holds what the data leave open."""
        return _PENALTY * (theta - self.search.initial), _PENALTY * np.eye(len(theta))

    def regrouped(self, theta: Array) -> Array:
        """Theta itself."""
        return theta

    def random_start(self, random: np.random.Generator) -> Array:
        """Near the prior: far from it lie poor optima, and filters that weigh no sensor."""
        return self.search.initial + _SCATTER * random.standard_normal(len(self.search.initial))


def estimate_of(found: Filter, segment: Segment) -> Array:
    """The filter's estimate over a segment in degC, without an offset (N,)."""
    system = first_order_hold(found.system, segment.period_s)
    return _Moved(system, segment.inputs).estimate


def _sampled(value: Filter, slopes: Filter, period_s: float) -> tuple[StateSpace, StateSpace]:
    system, count = value.system, len(slopes.A)
    still = [np.zeros((count, *each.shape)) for each in (system.C, system.D, system.offset)]
    moving = StateSpace(slopes.A, slopes.B, *still)
    return first_order_hold(system, period_s), discretised_slopes(system, moving, period_s, "first-order")


class _Moved:
    """A recursion in Schur coordinates, and what its state and inputs have moved since the start."""

    def __init__(self, system: StateSpace, u: Array) -> None:
        self.system = system
        self.upper, self.basis = schur(system.A)
        self.C = (system.C @ self.basis)[0]
        self.inputs = u - u[:, :1]
        self.states = states_from_rest(self.upper, (self.basis.T @ system.B) @ self.inputs)
        self.left = np.linalg.solve((np.eye(len(system.A)) - system.A).T, system.C[0])
        self.right = np.linalg.solve(np.eye(len(system.A)) - system.A, system.B)
        self.estimate: Array = self.C @ self.states + system.D[0] @ self.inputs
        self.estimate += (system.D[0] + self.left @ system.B) @ u[:, 0]

    def slopes(self, by: StateSpace, u: Array) -> Array:
        """The estimate's slopes (P, N) where the system's matrices have the slopes ``by``."""
        at_rest = by.D[:, 0] + by.C[:, 0] @ self.right + self.left @ (by.A @ self.right + by.B)
        driven = responses_of_output(self.upper, self.C, np.concatenate([self.states, self.inputs]))
        turned = self.basis.T
        weights = np.concatenate([turned @ by.A @ self.basis, turned @ by.B], axis=-1)
        found: Array = weights.reshape(len(weights), -1) @ driven.reshape(-1, u.shape[1])
        found += (by.C[:, 0] @ self.basis) @ self.states
        found += by.D[:, 0] @ self.inputs
        found += at_rest @ u[:, :1]
        return found


def _signals(system: StateSpace, slopes: StateSpace, u: Array) -> Array:
    moved = _Moved(system, u)
    return np.concatenate([moved.estimate[None], np.ones((1, u.shape[1])), moved.slopes(slopes, u)])


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
