"""A linear time-invariant system in state space: its inputs between two samples, its steady state, fewer states."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from ambient_trainer.data.trace import Array

Hold = Literal["first-order", "zero-order"]


@dataclass(frozen=True)
class StateSpace:
    """Continuous dx/dt = A x + B u, y = C x + D u + offset.

    Shapes: A (n, n), B (n, m), C (q, n), D (q, m), offset (q,); x and y in degC, time in s.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    offset: Array


def equilibrium(system: StateSpace) -> Array:
    """Steady state per unit of each constant input, -A^-1 B, shape (n, m): the X0 of a model file."""
    return np.asarray(-np.linalg.solve(system.A, system.B), dtype=np.float64)


def passive_modes(A: Array, capacitance: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues (n,), right and left eigenvectors (n, n) of a passive circuit's A = -diag(1/capacitance) G.

    G is symmetric, so sqrt(C) A / sqrt(C) is too: the eigenvalues are real and the eigenvectors orthogonal in those
    coordinates, however close two of them lie.
    """
    root = np.sqrt(capacitance)
    rates, Q = np.linalg.eigh(A * root[:, None] / root)
    return rates, Q / root[:, None], Q.T * root


def dc_gain(system: StateSpace) -> Array:
    """Steady-state gain (q, m) from each input to each output of a stable system: D - C A^-1 B."""
    return np.asarray(system.D + system.C @ equilibrium(system))


def reduced(system: StateSpace, most_states: int) -> StateSpace:
    """``system`` (stable, one output) with at most ``most_states`` states that hardly differs: balanced truncation.

    In balanced coordinates a state that is hard to drive is as hard to see (Moore 1981, IEEE Trans. Autom. Control
    26(1)); the weakest are left out, by the square-root method (Tombs and Postlethwaite 1987, Int. J. Control 46(4)).
    What they contributed in steady state acts at once instead, so that the DC gains stay what they are.
    """
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
