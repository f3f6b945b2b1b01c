"""Continuous becomes discrete here and nowhere else: exactly, by the matrix exponential.

With E(t) = exp(A t), Phi1 = int_0^T E, Phi2 = int_0^T E(T - s) s ds, inputs that move along straight lines between the
samples (first-order hold) give

    x[k+1] = E x[k] + (Phi1 - Phi2/T) B u[k] + (Phi2/T) B u[k+1].

In the coordinates z with x = (Phi1/T) z + (Phi2/T) B u this is

    z[k+1] = E z[k] + Phi1 B u[k],    y[k] = C (Phi1/T) z[k] + (D + C (Phi2/T) B) u[k],

which has the A and B of the zero-order hold: only C and D change. The equilibrium z = -A^-1 B u is then the same at
every period, so one X0 serves them all.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.statespace import Hold, StateSpace


def zero_order_hold(system: StateSpace, period_s: float) -> StateSpace:
    """The discrete system whose inputs stay constant between the samples."""
    E, Phi1, _ = _integrals(system.A, period_s)
    return StateSpace(E, Phi1 @ system.B, system.C, system.D, system.offset)


def first_order_hold(system: StateSpace, period_s: float) -> StateSpace:
    """The discrete system whose inputs move along straight lines between the samples."""
    E, Phi1, Phi2 = _integrals(system.A, period_s)
    return StateSpace(
        E,
        Phi1 @ system.B,
        system.C @ Phi1 / period_s,
        system.D + system.C @ Phi2 @ system.B / period_s,
        system.offset,
    )


def discretised(system: StateSpace, period_s: float, hold: Hold) -> StateSpace:
    """The discrete system by the hold's name."""
    return (first_order_hold if hold == "first-order" else zero_order_hold)(system, period_s)


def discretised_slopes(system: StateSpace, slopes: StateSpace, period_s: float, hold: Hold) -> StateSpace:
    """The derivative of :func:`discretised`; ``slopes`` and the result have a leading axis of parameters.

    d exp(A) in the direction dA is the corner of exp([[A, dA], [0, A]]).
    """
    T = period_s
    _, Phi1, Phi2 = _integrals(system.A, T)
    dE, dPhi1, dPhi2 = _integral_slopes(system.A, slopes.A, T)
    dB = dPhi1 @ system.B + Phi1 @ slopes.B
    if hold == "zero-order":
        return StateSpace(dE, dB, slopes.C, slopes.D, slopes.offset)
    dC = (slopes.C @ Phi1 + system.C @ dPhi1) / T
    dD = slopes.D + (slopes.C @ (Phi2 @ system.B) + system.C @ (dPhi2 @ system.B + Phi2 @ slopes.B)) / T
    return StateSpace(dE, dB, dC, dD, slopes.offset)


def _augmented(A: Array, T: float) -> Array:
    """[[A, I, 0], [0, 0, I], [0, 0, 0]] T, whose exponential holds E, Phi1 and Phi2 in its first block row."""
    n = A.shape[0]
    block = np.zeros((3 * n, 3 * n))
    block[:n, :n] = A * T
    block[:n, n : 2 * n] = block[n : 2 * n, 2 * n :] = np.eye(n) * T
    return block


def _integrals(A: Array, T: float) -> tuple[Array, Array, Array]:
    n = A.shape[0]
    if n == 0:
        return A, A, A
    top = expm(_augmented(A, T))[:n]
    return top[:, :n], top[:, n : 2 * n], top[:, 2 * n :]


def _integral_slopes(A: Array, dA: Array, T: float) -> tuple[Array, Array, Array]:
    n, count = A.shape[0], dA.shape[0]
    moving = np.flatnonzero(dA.any(axis=(1, 2)))
    slopes = np.zeros((3, count, n, n))
    if len(moving):
        block = np.zeros((len(moving), 6 * n, 6 * n))
        block[:, : 3 * n, : 3 * n] = block[:, 3 * n :, 3 * n :] = _augmented(A, T)
        block[:, :n, 3 * n : 4 * n] = dA[moving] * T
        corner = expm(block)[:, :n, 3 * n :]
        for index in range(3):
            slopes[index, moving] = corner[:, :, index * n : (index + 1) * n]
    return slopes[0], slopes[1], slopes[2]
