"""The steady state of a Kalman filter, for one system or a stack of them, real or complex.

Structured doubling (Chu, Fan, Lin, Wang 2004, Int. J. Control 77(8)) solves the discrete equation

    P = A P A' - A P (I + G P)^-1 G P A' + Q,    G = H' R^-1 H,

each pass doing as much as all before it. The continuous one, A P + P A' - P G P + Q = 0, becomes such a one by a Cayley
transform (Chu, Fan, Lin 2005, Linear Algebra Appl. 396). No complex conjugate is taken anywhere: the solution is
analytic in its arguments, and a complex step differentiates it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Stack = NDArray[Any]
"""Matrices, real or complex, with any leading axes."""

_SETTLED = 1e-13
_MOST_DOUBLINGS = 60


class Unsettled(ArithmeticError):
    """No steady state was found: the system cannot be observed, or is too badly scaled."""


def sampled_covariance(A: Stack, G: Stack, Q: Stack) -> Stack:
    """P (..., n, n) before a sample, of the discrete equation; raises :class:`Unsettled`."""
    identity, n = np.eye(A.shape[-1]), A.shape[-1]
    step, gain, P = transposed(A), G, Q
    for _ in range(_MOST_DOUBLINGS):
        solved = _inverse(identity + gain @ P) @ np.concatenate([step, gain], axis=-1)
        by_step, by_gain = solved[..., :n], solved[..., n:]
        grown = _symmetric(P + transposed(step) @ P @ by_step)
        gain = _symmetric(gain + step @ by_gain @ transposed(step))
        step = step @ by_step
        moved, size = np.abs(grown - P).max(), np.abs(grown).max()
        P = grown
        if not np.isfinite(size):
            break
        if moved <= _SETTLED * size:
            return P
    raise Unsettled("the Riccati equation does not settle")


def continuous_covariance(A: Stack, G: Stack, Q: Stack) -> Stack:
    """P (..., n, n) of the continuous equation; raises :class:`Unsettled`."""
    # as fast as the circuit or as its filter, whichever is faster
    shift = max(2 * float(np.abs(A).max()), float(np.sqrt(np.abs(G @ Q).max())))
    shifted = transposed(A) - shift * np.eye(A.shape[-1])
    inverse = _inverse(shifted)
    W = _inverse(shifted + G @ transposed(inverse) @ Q)
    step = np.eye(A.shape[-1]) + 2 * shift * W
    gain, noise = 2 * shift * inverse @ G @ transposed(W), 2 * shift * transposed(W) @ Q @ inverse
    return sampled_covariance(transposed(step), _symmetric(gain), _symmetric(noise))


def transposed(matrix: Stack) -> Stack:
    """The matrices' transposes, without a conjugate."""
    return np.swapaxes(matrix, -1, -2)


def _inverse(matrix: Stack) -> Stack:
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError as error:
        raise Unsettled("the Riccati equation is too badly scaled") from error


def _symmetric(matrix: Stack) -> Stack:
    return (matrix + transposed(matrix)) / 2
