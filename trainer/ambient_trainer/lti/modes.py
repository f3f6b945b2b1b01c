"""Modes of a system, and the one-pole filters 1/(z - a) that they are: never a loop over samples."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged


def one_pole(a: float, rows: Array, start: Array) -> Array:
    """x[k+1] = a x[k] + rows[k] with x[0] = start; ``rows`` (c, N), ``start`` (c,), result (c, N)."""
    filtered, _ = lfilter([0.0, 1.0], [1.0, -a], rows, axis=-1, zi=np.reshape(start, (-1, 1)))
    return np.asarray(filtered)


def passive_modes(A: Array, capacitance: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues (n,), right and left eigenvectors (n, n) of a passive circuit's A = -diag(1/capacitance) G.

    G is symmetric, so sqrt(C) A / sqrt(C) is too: the eigenvalues are real and the eigenvectors orthogonal in those
    coordinates, however close two of them lie.
    """
    root = np.sqrt(capacitance)
    rates, Q = np.linalg.eigh(A * root[:, None] / root)
    return rates, Q / root[:, None], Q.T * root


def modal_response(rates: Array, drive: Array, period_s: float, start: float | None = None) -> Array:
    """Modes x (..., n, N) of dx/dt = rate x + drive, which runs straight between samples; ``rates`` (n,) below 0.

    They begin at ``start``, or settled at the first sample.
    """
    modes = [lagged(drive[..., m, :] / -rate, -1 / rate, period_s, start) for m, rate in enumerate(rates.tolist())]
    return np.stack(modes, axis=-2)
