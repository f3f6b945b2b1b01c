"""A structure is what can be fitted: outputs that are linear in some unknowns beta and not in the others, theta.

y_o = f_o(theta) + sum_i beta_i F_oi(theta)
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array


@dataclass(frozen=True)
class Unknowns:
    """Names, bounds and starting values of a set of unknowns, each of shape (count,)."""

    names: tuple[str, ...]
    initial: Array
    low: Array
    high: Array


class Structure(ABC):
    """What the search needs to know of a model; by default of one without penalty and with one meaning a theta."""

    search: Unknowns
    """theta, in the coordinates of the search."""
    linear: Unknowns
    """beta; ``initial`` is not used."""
    segments: Sequence[Segment]

    @abstractmethod
    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """The outputs of segment ``index`` with beta = 0, (q, N), and what each of beta adds to them, (p, q, N)."""

    @abstractmethod
    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """The outputs' derivatives in theta, (P, q, N)."""

    @abstractmethod
    def random_start(self, random: np.random.Generator) -> Array:
        """Another theta to start from, within the bounds."""

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """By how much theta leaves what is plausible: (c,), zero where it does not, and its Jacobian (c, P)."""
        return np.zeros(0), np.zeros((0, len(theta)))

    def regrouped(self, theta: Array) -> Array:
        """The same point in better coordinates, where there are any; else theta itself."""
        return theta

    def predicted(self, theta: Array, beta: Array, index: int) -> Array:
        """The outputs (q, N) of segment ``index``."""
        fixed, free = self.regressors(theta, index)
        return np.asarray(fixed + np.tensordot(beta, free, 1))
