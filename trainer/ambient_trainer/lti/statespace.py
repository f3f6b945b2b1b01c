"""A linear time-invariant system in state space, and how its inputs move between two samples."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

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
