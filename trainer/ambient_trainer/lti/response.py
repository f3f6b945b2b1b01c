"""Responses of a small linear recursion to long inputs, at the speed of arrays.

In real Schur coordinates the recursion is triangular but for the damped pairs on its diagonal: one filter of first or
second order after the other. It does not mind poles that lie close together, which modal coordinates do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.discretise import discretised, first_order_hold
from ambient_trainer.lti.statespace import Hold, StateSpace, equilibrium

_DIVERGED_DEGC = 1e9


def states_from_rest(upper: Array, drive: Array) -> Array:
    """x (n, N) of x[k+1] = upper x[k] + drive[k] with x[0] = 0; ``upper`` is of a real Schur form, ``drive`` (n, N)."""
    x = np.empty_like(drive)
    for rows in reversed(list(_blocks(upper))):
        x[rows] = _run(upper[rows, rows], drive[rows] + upper[rows, rows.stop :] @ x[rows.stop :])
    return x


def responses_of_output(upper: Array, C: Array, signals: Array) -> Array:
    """Per state i and signal j (n, s, N): what C x makes of the signal where it drives state i alone.

    C (zI - A)^-1 e_i = e_i' (zI - A')^-1 C': one run of the adjoint a signal gives all of them.
    """
    found = np.empty((len(upper), *signals.shape))
    for rows in _blocks(upper):
        total = C[rows, None, None] * signals
        for above in range(rows.start):
            total += upper[above, rows, None, None] * found[above]
        found[rows] = _run(upper[rows, rows].T, total)
    return found


def _blocks(upper: Array) -> Iterator[slice]:
    """The rows of each pole, and of each damped pair of poles, from the top."""
    row = 0
    while row < len(upper):
        size = 2 if row + 1 < len(upper) and upper[row + 1, row] else 1
        yield slice(row, row + size)
        row += size


def _run(block: Array, drive: Array) -> Array:
    """x[k+1] = block x[k] + drive[k] from rest, for a block of one state or two: drive (1 or 2, ..., N)."""
    if len(block) == 1:
        return np.asarray(lfilter([0.0, 1.0], [1.0, -block[0, 0]], drive, axis=-1))
    (a, b), (c, d) = block
    once = lfilter([0.0, 1.0], [1.0, -(a + d), a * d - b * c], drive, axis=-1)
    x = once.copy()
    # (zI - block)^-1 = [[z - d, b], [c, z - a]] / det
    x[0, ..., 1:] += b * once[1, ..., :-1] - d * once[0, ..., :-1]
    x[1, ..., 1:] += c * once[0, ..., :-1] - a * once[1, ..., :-1]
    return np.asarray(x)


def response_degC(system: StateSpace, hold: Hold, u: Array, period_s: float) -> Array:
    """The same over uniform inputs ``u`` (m, N) without gaps: shape (N,)."""
    discrete = discretised(system, period_s, hold)
    with np.errstate(over="ignore", invalid="ignore"):
        x = states(discrete.A, discrete.B @ u, equilibrium(system) @ u[:, 0])
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


def noise_gain(system: StateSpace, period_s: float) -> float:
    """Standard deviation of the first output of stable ``system`` per unit of white noise in every input."""
    discrete = first_order_hold(system, period_s)
    covariance = solve_discrete_lyapunov(discrete.A, discrete.B @ discrete.B.T)
    return math.sqrt(float((discrete.C @ covariance @ discrete.C.T)[0, 0]) + float(np.sum(discrete.D[0] ** 2)))
