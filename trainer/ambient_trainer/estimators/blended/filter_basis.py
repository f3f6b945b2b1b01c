"""The signals that a filter of four states is a weighted sum of, and what white noise becomes in it, exactly.

Per input: the input itself and, for each of two sections of second order, the input behind it and the difference of
that to its last value, scaled to like size. Everything that is quadratic in the weights is then one Gram matrix.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import lfilter

Array = NDArray[np.float64]

SIGNALS = 5
"""Per input."""


def denominators(poles: Array, period_s: float) -> list[Array]:
    """Per section the discrete denominator [1, a1, a2]; ``poles`` are (log omega, log zeta) of each, omega in 1/s."""
    found = []
    for omega, zeta in np.exp(poles).reshape(-1, 2):
        root = np.sqrt(complex(zeta * zeta - 1))
        slow, fast = np.exp(omega * period_s * (-zeta + root)), np.exp(omega * period_s * (-zeta - root))
        found.append(np.array([1.0, -(slow + fast).real, (slow * fast).real]))
    return found


def signals(poles: Array, period_s: float, inputs: Array, every: int = 1) -> Array:
    """Each ``every``-th sample of all signals, (5 m, ...), of ``inputs`` (m, N), signal by signal.

    From equilibrium with the first sample.
    """
    rows = [inputs[:, ::every]]
    start = inputs[:, :1]
    # two samples of equilibrium ahead: the filtered signal is read one and two samples late
    moved = np.concatenate([np.zeros((len(inputs), 2)), inputs - start], axis=1)
    for a in denominators(poles, period_s):
        filtered = lfilter([a.sum()], a, moved, axis=1)
        last, before = filtered[:, 1:-1:every], filtered[:, :-2:every]
        rows += [last + start, (last - before) / math.sqrt(a.sum())]
    return np.concatenate(rows)


def dc_gains(inputs: int) -> Array:
    """Per input (row) and weight (column) what the weight adds to the input's DC gain."""
    return np.asarray(np.kron([1.0, 1.0, 0.0, 1.0, 0.0], np.eye(inputs)), dtype=np.float64)


def noise_gram(poles: Array, period_s: float, inputs: int) -> Array:
    """N with w' N w = the output's variance per variance of white noise in every input.

    With x[k+1] = A x[k] + B v[k] and the signals C x + D v of one input, their covariance is C P C' + D D', where
    P = A P A' + B B'.
    """
    A, B, C, D = np.zeros((4, 4)), np.zeros((4, 1)), np.zeros((SIGNALS, 4)), np.zeros((SIGNALS, 1))
    D[0] = 1.0
    for section, a in enumerate(denominators(poles, period_s)):
        at, row = 2 * section, 1 + 2 * section
        A[at : at + 2, at : at + 2] = [[-a[1], -a[2]], [1.0, 0.0]]
        B[at] = a.sum()
        C[row, at] = 1.0
        C[row + 1, at : at + 2] = np.array([1.0, -1.0]) / math.sqrt(a.sum())
    P = solve_discrete_lyapunov(A, B @ B.T)
    return np.kron(C @ P @ C.T + D @ D.T, np.eye(inputs))


def numerators(poles: Array, period_s: float, weights: Array) -> tuple[Array, list[Array]]:
    """The direct gains (m,) and per section the numerators (2, m) of z^-1 and z^-2 over its denominator.

    ``weights`` (5 m,) are those of :func:`signals`.
    """
    direct, *rest = weights.reshape(SIGNALS, -1)
    found = []
    for a, level, change in zip(denominators(poles, period_s), rest[::2], rest[1::2]):
        total = a.sum()
        found.append(np.vstack([level * total + change * math.sqrt(total), -change * math.sqrt(total)]))
    return direct, found
