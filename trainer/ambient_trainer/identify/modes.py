"""Signals come from one-pole filters 1/(z - a), run by ``scipy.signal.lfilter``: never a loop over samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


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
