"""Responses of a small linear recursion to long inputs, at the speed of arrays.

In real Schur coordinates the recursion is triangular but for the damped pairs on its diagonal: one filter of first or
second order after the other. It does not mind poles that lie close together, which modal coordinates do.
"""

import math

import numpy as np
from scipy.linalg import matrix_balance, schur, solve_discrete_lyapunov
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.discretise import discretised, discretised_slopes
from ambient_trainer.lti.statespace import Hold, StateSpace, equilibrium

_DIVERGED_DEGC = 1e9


def states(A: Array, drive: Array, start: Array) -> Array:
    """x (n, ..., N) of x[k+1] = A x[k] + drive[k] with x[0] = start (n, ...).

    ``drive`` is (n, ..., N); its last sample is not used.
    """
    if not np.isfinite(A).all():
        return np.full_like(drive, np.nan)
    upper, basis = _schur(A)
    return np.tensordot(basis, _triangular(upper, np.tensordot(basis.T, drive, 1), basis.T @ start), 1)


def response(system: StateSpace, hold: Hold, u: Array, period_s: float) -> Array:
    """The outputs (q, N) of continuous ``system`` over uniform inputs ``u`` (m, N), from equilibrium with the first."""
    discrete = discretised(system, period_s, hold)
    x = states(discrete.A, discrete.B @ u, equilibrium(system) @ u[:, 0])
    return np.asarray(discrete.C @ x + discrete.D @ u + discrete.offset[:, None])


def response_slopes(
    system: StateSpace, slopes: StateSpace, hold: Hold, u: Array, period_s: float, start: Array | float = 0.0
) -> Array:
    """Derivatives (P, q, N) of the outputs of a system whose matrices have ``slopes``, with a leading axis (P, ...).

    It starts from equilibrium with the first of ``u`` (m, N), plus ``start`` (n,).
    """
    value, by = discretised(system, period_s, hold), discretised_slopes(system, slopes, period_s, hold)
    upper, basis = _schur(value.A)
    rest = equilibrium(system)
    rest_slopes = -np.linalg.solve(system.A, slopes.A @ rest + slopes.B)
    (P, q), n, (m, N) = by.offset.shape, len(system.A), u.shape
    x = _triangular(upper, basis.T @ value.B @ u, basis.T @ (rest @ u[:, 0] + start))
    table = np.concatenate([x, u])
    drive = np.concatenate([basis.T @ by.A @ basis, basis.T @ by.B], axis=-1).swapaxes(0, 1)
    starts = basis.T @ (rest_slopes @ u[:, 0]).T
    driven = _triangular(upper, (drive.reshape(n * P, n + m) @ table).reshape(n, P, N), starts)
    direct = np.concatenate([by.C @ basis, by.D], axis=-1).reshape(P * q, n + m) @ table
    read = (value.C @ basis @ driven.reshape(n, P * N)).reshape(q, P, N)
    return np.asarray(direct.reshape(P, q, N) + by.offset[..., None] + read.swapaxes(0, 1))


def response_degC(system: StateSpace, hold: Hold, u: Array, period_s: float) -> Array:
    """The first output over uniform inputs ``u`` (m, N) without gaps, (N,); NaN where it has diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        y = response(system, hold, u, period_s)[0]
        return np.where(np.abs(y) < _DIVERGED_DEGC, y, np.nan)


def noise_gain(system: StateSpace, period_s: float) -> float:
    """Standard deviation of the first output of stable ``system`` per unit of white noise in every input."""
    discrete = discretised(system, period_s, "first-order")
    # states in other units by many orders of magnitude cost as many digits
    A, units = matrix_balance(discrete.A, permute=False)
    B, C = np.linalg.solve(units, discrete.B), discrete.C @ units
    covariance = solve_discrete_lyapunov(A, B @ B.T)
    return math.sqrt(float((C @ covariance @ C.T)[0, 0]) + float(np.sum(discrete.D[0] ** 2)))


def _schur(A: Array) -> tuple[Array, Array]:
    return schur(A) if len(A) else (A, A)


def _triangular(upper: Array, drive: Array, start: Array) -> Array:
    """As :func:`states`, in real Schur coordinates."""
    x = np.concatenate([start[..., None], drive[..., :-1]], axis=-1)
    row = len(upper)
    while row:
        # a pole, or a damped pair of them
        rows = slice(row - (2 if row > 1 and upper[row - 1, row - 2] else 1), row)
        x[rows, ..., 1:] += np.tensordot(upper[rows, row:], x[row:], 1)[..., :-1]
        x[rows] = _run(upper[rows, rows], x[rows])
        row = rows.start
    return x


def _run(block: Array, shifted: Array) -> Array:
    """x[k+1] = block x[k] + shifted[k+1] with x[0] = shifted[0], for a block of one state or two: (1 or 2, ..., N)."""
    if len(block) == 1:
        return np.asarray(lfilter([1.0], [1.0, -block[0, 0]], shifted, axis=-1))
    # LAPACK's block of a damped pair, [[a, b], [c, a]] with b c < 0, turns x_0 + i k x_1 by a + i k c
    (a, b), (c, _) = block
    k = math.sqrt(-b / c)
    turned = lfilter([1.0], [1.0, -(a + 1j * k * c)], shifted[0] + 1j * k * shifted[1], axis=-1)
    return np.stack([turned.real, turned.imag / k])
