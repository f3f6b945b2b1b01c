"""A linear time-invariant system in state space, and how its inputs move between two samples."""

from __future__ import annotations

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


def dc_gain(system: StateSpace) -> Array:
    """Steady-state gain from each input to each output.

    Parameters
    ----------
    system : StateSpace
        Stable and continuous.

    Returns
    -------
    array (q, m)
        D - C A^-1 B.
    """
    found: Array = system.D + system.C @ equilibrium(system)
    return found
