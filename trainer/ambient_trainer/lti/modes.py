"""Signals come from one-pole filters 1/(z - a), run by ``scipy.signal.lfilter``: never a loop over samples.

Two filters in series are, by partial fractions, a difference of single ones,

    1/((z - a_i)(z - a_k)) = (1/(z - a_i) - 1/(z - a_k)) / (a_i - a_k),

but where a_i and a_k are so close that the difference would be rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged

_CLOSE = 1e-3
"""Of the faster of two poles' distance from 1: so many digits may be lost to the difference."""


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


@dataclass(frozen=True)
class Pairs:
    """Which filters in series (i after k) need a signal of their own, and what makes the others of single ones."""

    own: NDArray[np.bool_]
    """(n, n)"""
    gap: Array
    """a_i - a_k (n, n), 1 where ``own``."""

    @staticmethod
    def of(poles: Array) -> Pairs:
        """The pairs of ``poles`` (n,), which are taken as they were rounded: their filters are."""
        gap = np.subtract.outer(poles, poles)
        own = np.abs(gap) <= _CLOSE * (1 - np.minimum.outer(poles, poles))
        own |= np.eye(len(poles), dtype=bool)
        return Pairs(own, np.where(own, 1.0, gap))

    @property
    def count(self) -> int:
        """How many pairs need a signal of their own."""
        return int(self.own.sum())

    def parted(self, series: Array) -> tuple[Array, Array]:
        """Coefficients (..., n, n) of all pairs as those of pairs with an own signal (..., c), and quotients.

        A quotient (..., n, n) is what stands before (1/(z - a_i) - 1/(z - a_k)) in place of the pair.
        """
        return series[..., self.own], np.where(self.own, 0.0, series / self.gap)
