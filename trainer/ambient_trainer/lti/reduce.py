"""A large filter becomes one of few states that hardly differs: balanced truncation.

In balanced coordinates a state that is hard to drive is as hard to see (Moore 1981, IEEE Trans. Autom. Control 26(1));
the weakest are left out, by the square-root method (Tombs and Postlethwaite 1987, Int. J. Control 46(4)). What they
contributed in steady state acts at once instead, so that the DC gains stay what they are.
"""

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.statespace import StateSpace, dc_gain


def reduced(system: StateSpace, most_states: int) -> StateSpace:
    """``system`` (stable, one output) with at most ``most_states`` states."""
    if len(system.A) <= most_states:
        return system
    left = _root(solve_continuous_lyapunov(system.A.T, -system.C.T @ system.C))
    right = _root(solve_continuous_lyapunov(system.A, -system.B @ system.B.T))
    U, strength, Vt = np.linalg.svd(left.T @ right)
    kept = np.sqrt(strength[:most_states])
    to_kept, from_kept = (U[:, :most_states] / kept).T @ left.T, right @ Vt[:most_states].T / kept
    A, B, C = to_kept @ system.A @ from_kept, to_kept @ system.B, system.C @ from_kept
    return StateSpace(A, B, C, dc_gain(system) + C @ np.linalg.solve(A, B), system.offset)


def _root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
