"""``circuit_observer``: the steady-state Kalman filter of a circuit under a random-walk ambient.

Circuit, process and measurement noise minimise its error of the reference (prediction-error form). The likelihood of
the sensors' own innovations does not determine the ambient's scale: a wider walk behind longer time constants gives the
same sensors.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from ambient_model.faults import refuse
from ambient_model.trace import split_column
from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation import Progress, Structure, Unknowns, search
from ambient_trainer.estimators.base import Effort, Estimator, Fit, Training, require_enough
from ambient_trainer.estimators.searched import MODES, fit_of, late, rescored, with_fallbacks_and_variance
from ambient_trainer.lti import StateSpace, lagged, reduced, response_degC, response_slopes
from ambient_trainer.lti.response import response

_COMPLEX_STEP = 1e-30


class RandomWalkAmbient(Structure):
    """Measured nodes that exchange heat with a random-walk ambient and with each other, and its Kalman filter.

        dT_i = ((T_a - T_i)/tau_i + sum_j g_ij/C_i (T_j - T_i)) dt + q_i dw_i
        dT_a = q_a dw_a,    z_i = T_i + r_i v_i

    tau in s, g in W/K, C in J/K as a multiple of the first node's, q in K/sqrt(s), r in K sqrt(s): only ratios of C and
    g are identifiable. ``walk``, which is q_a, is given: the filter does not change where q and r are scaled alike.
    With A of the circuit, H = [I 0] and P of A P + P A' - P H' R^-1 H P + Q = 0 its steady state is (Kalman and Bucy
    1961, J. Basic Eng. 83)

        dx/dt = (A - K H) x + K z,    T_a = e_a' x,    K = P H' R^-1,

    made discrete by the first-order hold. The filter of the circuit sampled at a coarse period may have poles of
    alternating sign, and no counterpart at another period. theta (P,) holds the logarithms of ``names``; it is searched
    over ``segments`` from a prior, by default the best of a coarse grid.
    """

    def __init__(
        self,
        sensors: Sequence[str],
        walk: float,
        segments: Sequence[Segment] = (),
        prior: Mapping[str, float] | None = None,
    ) -> None:
        nodes = [split_column(column)[0] for column in sensors]
        self.walk, self.segments, self.count = walk, segments, len(nodes)
        self.pairs = tuple(itertools.combinations(range(self.count), 2))
        groups = (
            ("tau", nodes, "s"),
            ("C", nodes[1:], "1"),
            ("g", [f"{nodes[i]}_{nodes[j]}" for i, j in self.pairs], "1/s"),
            ("q", nodes, "K/sqrt(s)"),
            ("r", nodes, "K sqrt(s)"),
        )
        self.units = {f"{kind}_{each}": unit for kind, names, unit in groups for each in names}
        self.names = tuple(self.units)
        if segments:
            start = self.coarse_prior() if prior is None else np.array([prior[name] for name in self.names])
            self.search = Unknowns(self.names, start, start - _REACH, start + _REACH)
            self.linear = Unknowns(("offset",), np.zeros(1), np.full(1, -np.inf), np.full(1, np.inf))

    def filter(self, theta: Array) -> StateSpace:
        """The steady-state filter at ``theta`` (P,); raises ``ValueError`` where there is none."""
        A, K, _, _ = self._solved(theta)
        n, m = K.shape
        return StateSpace(A, K, np.eye(1, n, n - 1), np.zeros((1, m)), np.zeros(1))

    def filter_slopes(self, theta: Array) -> StateSpace:
        """The derivative of :meth:`filter` in each of theta, with a leading axis; that of the covariance, dP, solves

            (A - K H) dP + dP (A - K H)' + dA P + P dA' + dQ + K dR K' = 0.

        Those of A, Q and R come by a complex step (Squire and Trapp 1998, SIAM Review 40(1)), to the last bit.
        """
        Ac, K, P, R = self._solved(theta)
        found = []
        for step in _COMPLEX_STEP * 1j * np.eye(len(theta)):
            dA, dQ, dR = (each.imag / _COMPLEX_STEP for each in self.process(theta + step))
            dP = solve_continuous_lyapunov(Ac, -(dA @ P + P @ dA.T + dQ + (K * dR) @ K.T))
            dK = (dP[:, : self.count] - K * dR) / R
            found.append((dA - dK @ np.eye(*dK.T.shape), dK))
        dA, dK = map(np.array, zip(*found))
        still = (np.zeros((len(theta), *shape)) for shape in ((1, self.count + 1), (1, self.count), (1,)))
        return StateSpace(dA, dK, *still)

    def _solved(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """A - K H, K, P, and the diagonal of R."""
        A, Q, R = self.process(theta)
        H = np.eye(self.count, self.count + 1)
        P = solve_continuous_are(A.T, H.T, Q, np.diag(R))
        # a step of Newton's (Kleinman 1968, IEEE Trans. Autom. Control 13(1)) brings the digits that a search needs
        K = P @ H.T / R
        P = solve_continuous_lyapunov(A - K @ H, -(Q + K * R @ K.T))
        K = P @ H.T / R
        return A - K @ H, K, P, R

    def process(self, theta: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """A and Q (n + 1, n + 1) of the circuit, the ambient last, and the diagonal of R (n,); real or complex."""
        n, edges = self.count, len(self.pairs)
        tau, C, g, q, r = np.split(np.exp(theta), np.cumsum([n, n - 1, edges, n]))
        C = np.append(1.0, C)
        A = np.zeros((n + 1, n + 1), dtype=theta.dtype)
        A[range(n), range(n)] = -1 / tau
        A[:n, n] = 1 / tau
        for rate, pair in zip(g, self.pairs):
            for i, j in (pair, pair[::-1]):
                A[i, i] -= rate / C[i]
                A[i, j] += rate / C[i]
        return A, np.diag(np.append(q, self.walk) ** 2), r**2

    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """The estimate without its offset, and one; zero where no filter settles, which loses to any other."""
        segment = self.segments[index]
        one = np.ones((1, 1, segment.inputs.shape[1]))
        try:
            estimate = response(self.filter(theta), "first-order", segment.inputs, segment.period_s)
        except ValueError:
            return 0 * one[0], one
        return np.nan_to_num(estimate), one

    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """The estimate's derivatives in theta, (P, 1, N)."""
        segment = self.segments[index]
        try:
            value, by = self.filter(theta), self.filter_slopes(theta)
        except ValueError:
            return np.zeros((len(theta), 1, segment.inputs.shape[1]))
        return np.nan_to_num(response_slopes(value, by, "first-order", segment.inputs, segment.period_s))

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """The penalty on the distance from the prior, which holds what the data leave open."""
        return _PENALTY * (theta - self.search.initial), _PENALTY * np.eye(len(theta))

    def random_start(self, random: np.random.Generator) -> Array:
        """Near the prior: far from it lie poor optima, and filters that weigh no sensor."""
        return self.search.initial + _SCATTER * random.standard_normal(len(self.search.initial))

    def coarse_prior(self) -> Array:
        """A theta to start from: the best of a coarse grid over how fast the filter is and how much the nodes walk."""
        n, edges, period_s = self.count, len(self.pairs), self.segments[0].period_s
        tau = np.array([_lag_s(self.segments, index) for index in range(n)])

        def theta(speed: float, share: float) -> Array:
            """With one sensor the filter's poles have the product walk/(tau r): ``speed`` squared."""
            exchange, walks = np.full(edges, _EXCHANGE / np.median(tau)), np.full(n, share * self.walk)
            return np.log(np.concatenate([tau, np.ones(n - 1), exchange, walks, self.walk / (tau * speed**2)]))

        def square(theta: Array) -> float:
            try:
                found = self.filter(theta)
            except ValueError:
                return math.inf
            errors = [s.outputs[0] - response_degC(found, "first-order", s.inputs, period_s) for s in self.segments]
            return float(np.nanvar(np.concatenate(errors)))

        speeds = np.geomspace(2 / period_s, 1 / max(tau.max(), 4 * period_s), _SPEEDS)
        return min((theta(speed, share) for speed in speeds for share in _WALKS), key=square)


NAMES = ("circuit_observer",)
_MOST_SENSORS = 8
_MOST_STATES = 4
_MOST_STARTS = 3
"""Held near the prior, all starts end at one place; three show that they do."""
_REACH = 8.0
"""How far theta may leave its prior: a factor of 3000."""
_PENALTY = 3e-4
"""Of an e-fold from the prior, as a share of the reference's norm: just enough to hold what the data leave open."""
_SCATTER = 0.15
_LAGS = 24
_SPEEDS = 7
_WALKS = (0.01, 0.1, 1.0)
"""The nodes' walks as shares of the ambient's."""
_EXCHANGE = 0.1
"""Conductance between nodes as a share of that to the ambient."""


def find(name: str) -> CircuitObserver | None:
    """The estimator called ``name``, or None."""
    return CircuitObserver() if name in NAMES else None


class CircuitObserver(Estimator):
    """Fits the observer, and one without each of its inputs."""

    name = NAMES[0]

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns; at most three of ``effort.starts`` are made.

        Raises :class:`Refused` for more sensors than a trace determines.
        """
        columns, segments, traces = training
        if len(columns) > _MOST_SENSORS:
            problem = f"{len(columns)} temperatures make a circuit with more unknowns than a trace determines"
            raise refuse(self.name, "", problem, f"name the best {_MOST_SENSORS} or fewer as its sensors")
        walk = walk_of(segments)
        whole = RandomWalkAmbient(columns, walk, segments)
        require_enough(traces, whole)
        main = _fitted(columns, whole, replace(effort, starts=min(effort.starts, _MOST_STARTS)), progress)

        def fallback(dropped: int) -> Fit:
            left, parts, _ = training.without(dropped)
            known = dict(zip(whole.names, np.log([each.value for each in main.parameters]).tolist()))
            # the circuit without a node has its capacities in terms of its own first one
            first = known[whole.names[whole.count]] if dropped == 0 else 0.0
            start = {name: value - first * name.startswith(("C_", "g_")) for name, value in known.items()}
            smaller = RandomWalkAmbient(left, walk, parts, start)
            return _fitted(left, smaller, replace(effort, starts=1, pieces=1), late(progress, effort))

        states = len(columns) + 1
        remark = f"The circuit has {states} states: a node a sensor, and the ambient"
        remark += f"; balanced down to {len(main.states)}." if states > len(main.states) else "."
        return with_fallbacks_and_variance(main, segments, (), fallback, remark, {"states_of_circuit": states})


def _fitted(columns: Sequence[str], circuit: RandomWalkAmbient, effort: Effort, progress: Progress | None) -> Fit:
    result = search(circuit, effort.starts, effort.seed, progress, effort.budget)
    theta = result.best.theta
    whole = circuit.filter(theta)
    whole.offset[:] = result.best.beta
    system = reduced(whole, _MOST_STATES)
    unknowns = [(name, unit, value, True) for (name, unit), value in zip(circuit.units.items(), np.exp(theta).tolist())]
    fit = fit_of(circuit, result, effort, system, unknowns, NAMES[0], columns, MODES[: len(system.A)])
    return rescored(fit, circuit.segments)


def walk_of(segments: Sequence[Segment]) -> float:
    """By how much the reference walks, in K/sqrt(s)."""
    squares, lasted_s = 0.0, 0.0
    for each in segments:
        known = np.flatnonzero(~np.isnan(each.outputs[0]))
        squares += float(np.sum(np.diff(each.outputs[0, known]) ** 2))
        lasted_s += float(np.ptp(known)) * each.period_s if len(known) else 0.0
    return math.sqrt(squares / lasted_s)


def _lag_s(segments: Sequence[Segment], index: int) -> float:
    """The time constant of the first-order lag behind the reference that comes nearest to the sensor."""
    period_s = segments[0].period_s
    longest_s = max(each.inputs.shape[1] for each in segments) * period_s / 4
    filled = [pd.Series(each.outputs[0]).interpolate(limit_direction="both").to_numpy() for each in segments]

    def far(lag_s: float) -> float:
        behind = [each.inputs[index] - lagged(reference, lag_s, period_s) for each, reference in zip(segments, filled)]
        return float(np.var(np.concatenate(behind)))

    return float(min(np.geomspace(period_s, max(longest_s, 2 * period_s), _LAGS), key=far))
