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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_model.trace import split_column
from ambient_trainer.lti.riccati import Stack, continuous_covariance
from ambient_trainer.lti.statespace import StateSpace

Array = NDArray[np.float64]

_COMPLEX_STEP = 1e-30


class Filter(NamedTuple):
    """dx/dt = A x + B z, y = x[-1]; stacked and complex ones too: A (..., n, n), B (..., n, m)."""

    A: NDArray[Any]
    B: NDArray[Any]

    @property
    def system(self) -> StateSpace:
        """The same (of a single real one) as a state space."""
        n, m = self.B.shape
        return StateSpace(self.A, self.B, np.eye(1, n, n - 1), np.zeros((1, m)), np.zeros(1))


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

    def filter(self, theta: Stack) -> Filter:
        """The steady-state filter at ``theta`` (..., P), real or complex; raises :class:`Unsettled`."""
        A, Q, R = self.process(theta)
        H = np.eye(self.count, self.count + 1)
        to_gain = H.T / R[..., None, :]
        K = continuous_covariance(A, to_gain @ H, Q) @ to_gain
        return Filter(A - K @ H, K)

    def filter_and_slopes(self, theta: Array) -> tuple[Filter, Filter]:
        """The filter at ``theta`` (P,), and its derivative in each of theta, to the last bit.

        By a complex step (Squire and Trapp 1998, SIAM Review 40(1)): f(x + ih) = f(x) + ih f'(x), however small h is.
        """
        stack = self.filter(theta + _COMPLEX_STEP * 1j * np.eye(len(theta)))
        return Filter(*(each[0].real for each in stack)), Filter(*(each.imag / _COMPLEX_STEP for each in stack))

    def process(self, theta: Stack) -> tuple[Stack, Stack, Stack]:
        """A and Q (..., n + 1, n + 1) of the circuit, the ambient last, and the diagonal of R (..., n)."""
        n, edges, stack = self.count, len(self.pairs), theta.shape[:-1]
        tau, C, g, q, r = np.split(np.exp(theta), np.cumsum([n, n - 1, edges, n]), axis=-1)
        C = np.concatenate([np.ones((*stack, 1)), C], axis=-1)
        A = np.zeros((*stack, n + 1, n + 1), dtype=theta.dtype)
        for i in range(n):
            A[..., i, i] -= 1 / tau[..., i]
            A[..., i, n] += 1 / tau[..., i]
        for index, pair in enumerate(self.pairs):
            for i, j in (pair, pair[::-1]):
                rate = g[..., index] / C[..., i]
                A[..., i, i] -= rate
                A[..., i, j] += rate
        walks = np.concatenate([q, np.full((*stack, 1), self.walk)], axis=-1)
        return A, walks[..., None] ** 2 * np.eye(n + 1), r**2
