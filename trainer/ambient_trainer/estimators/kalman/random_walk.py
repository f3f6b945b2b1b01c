"""The circuit of the observer: measured nodes that exchange heat with a random-walk ambient and with each other.

    dT_i = ((T_a - T_i)/tau_i + sum_j g_ij/C_i (T_j - T_i)) dt + q_i dw_i
    dT_a = q_a dw_a
    z_i  = T_i + r_i v_i

tau in s, g in W/K, C in J/K as a multiple of the first node's, q in K/sqrt(s), r in K sqrt(s). Heat is not measured, so
only ratios of C and g are identifiable. The filter does not change where all of q and r are scaled alike: q_a is given.

With A of the circuit, H = [I 0] and P of A P + P A' - P H' R^-1 H P + Q = 0 its steady-state Kalman filter (Kalman and
Bucy 1961, J. Basic Eng. 83) is

    dx/dt = (A - K H) x + K z,    T_a = e_a' x,    K = P H' R^-1,

a continuous system, made discrete for any period by the first-order hold. With lines drawn between the samples, the r
that serves it best is less than the sensors' own noise. The filter of the circuit sampled at a coarse period would be
another one: its poles may alternate in sign, and then it has no counterpart at any other period.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from ambient_model.trace import split_column
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.statespace import StateSpace

_COMPLEX_STEP = 1e-30


class RandomWalkAmbient:
    """The circuit over ``sensors`` (trace columns); ``walk`` is q_a in K/sqrt(s).

    theta (P,) holds the logarithms of ``names``.
    """

    def __init__(self, sensors: Sequence[str], walk: float) -> None:
        nodes = [split_column(column)[0] for column in sensors]
        self.walk = walk
        self.count = len(nodes)
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

    def filter(self, theta: Array) -> StateSpace:
        """The steady-state filter at ``theta`` (P,); raises ``ValueError`` where there is none."""
        A, K, _, _ = self._solved(theta)
        n, m = K.shape
        return StateSpace(A, K, np.eye(1, n, n - 1), np.zeros((1, m)), np.zeros(1))

    def slopes(self, theta: Array) -> StateSpace:
        """The derivative of :meth:`filter` in each of theta, with a leading axis.

        That of the covariance solves the Lyapunov equation that the Riccati equation has for its own, dP:

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
