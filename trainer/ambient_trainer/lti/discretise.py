"""Continuous becomes discrete here and nowhere else: exactly, by the matrix exponential.

With E(t) = exp(A t), Phi1 = int_0^T E, Phi2 = int_0^T E(T - s) s ds, inputs that move along straight lines between the
samples (first-order hold) give

    x[k+1] = E x[k] + (Phi1 - Phi2/T) B u[k] + (Phi2/T) B u[k+1].

In the coordinates z with x = (Phi1/T) z + (Phi2/T) B u this is

    z[k+1] = E z[k] + Phi1 B u[k],    y[k] = C (Phi1/T) z[k] + (D + C (Phi2/T) B) u[k],

which has the A and B of the zero-order hold: only C and D change. The equilibrium z = -A^-1 B u is then the same at
every period, so one X0 serves them all. Matrices may have leading axes: each function takes stacks.
"""

import numpy as np
from scipy.linalg import expm

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.statespace import Hold, StateSpace

_STEP = 1e-100


def discretised(system: StateSpace, period_s: float, hold: Hold) -> StateSpace:
    """The discrete system whose inputs between the samples move along straight lines, or stay constant."""
    E, Phi1, Phi2 = _integrals(system.A, period_s)
    if hold == "zero-order":
        return StateSpace(E, Phi1 @ system.B, system.C, system.D, system.offset)
    D = system.D + system.C @ Phi2 @ system.B / period_s
    return StateSpace(E, Phi1 @ system.B, system.C @ Phi1 / period_s, D, system.offset)


def discretised_slopes(system: StateSpace, slopes: StateSpace, period_s: float, hold: Hold) -> StateSpace:
    """The derivative of :func:`discretised`; ``slopes`` and the result have a leading axis of parameters.

    By a complex step, which is exact to the last digit (Al-Mohy and Higham 2010, Numer. Algorithms 53).
    """
    stepped = StateSpace(*(vars(system)[name] + 1j * _STEP * slope for name, slope in vars(slopes).items()))
    return StateSpace(*(each.imag / _STEP for each in vars(discretised(stepped, period_s, hold)).values()))


def _integrals(A: Array, T: float) -> tuple[Array, Array, Array]:
    """E, Phi1 and Phi2: the first block row of the exponential of [[A, I, 0], [0, 0, I], [0, 0, 0]] T."""
    n = A.shape[-1]
    if A.size == 0:
        return A, A, A
    block = np.zeros((*A.shape[:-2], 3 * n, 3 * n), A.dtype)
    block[..., :n, :n] = A * T
    block[..., :n, n : 2 * n] = block[..., n : 2 * n, 2 * n :] = np.eye(n) * T
    top = expm(block)[..., :n, :]
    return top[..., :n], top[..., n : 2 * n], top[..., 2 * n :]
