"""A fitted filter: its estimate over an array, its gains, and its continuous form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimators.blended.filter_basis import dc_gains, noise_gram, numerators, signals
from ambient_trainer.estimators.blended.poles import Searched
from ambient_trainer.lti.statespace import StateSpace

Array = NDArray[np.float64]

STATES = 4


@dataclass(frozen=True)
class TrainedFilter:
    """Poles and weights over the trace columns ``inputs``, at ``period_s``."""

    inputs: tuple[str, ...]
    period_s: float
    found: Searched

    def estimate_degC(self, sensors_degC: Array) -> Array:
        """The estimate (N,) over sensors (m, N), from equilibrium with the first sample."""
        weights = self.found.weights
        return np.asarray(weights[:-1] @ signals(self.found.poles, self.period_s, sensors_degC) + weights[-1])

    @property
    def noise_gain(self) -> float:
        """The output's standard deviation per that of white noise, independent in every input, at its period."""
        weights = self.found.weights[:-1]
        return float(np.sqrt(weights @ noise_gram(self.found.poles, self.period_s, len(self.inputs)) @ weights))

    @property
    def dc_gains(self) -> dict[str, float]:
        """Per input the DC gain."""
        gains = dc_gains(len(self.inputs)) @ self.found.weights[:-1]
        return dict(zip(self.inputs, gains.tolist()))

    @property
    def time_constants_s(self) -> list[complex]:
        """-1/pole, slowest first; a damped pair is complex."""
        return self._free_filter().time_constants_s(self.found.poles)

    def system(self) -> StateSpace:
        """The continuous system that is this filter under a first-order hold, of four states.

        A state is what one mode adds to the estimate, in degC, so that a norm shows the decay of a wrong start.
        """
        direct, sections = numerators(self.found.poles, self.period_s, self.found.weights[:-1])
        gains = np.concatenate([direct, self.found.weights[-1:], *(each.ravel() for each in sections)])
        system = self._free_filter().system(self.found.poles, gains)
        modes = block_diag(*(_modes(block) for block in (system.A[:2, :2], system.A[2:, 2:])))
        return StateSpace(
            np.linalg.solve(modes, system.A @ modes),
            np.linalg.solve(modes, system.B),
            system.C @ modes,
            system.D,
            system.offset,
        )

    def _free_filter(self) -> FreeFilter:
        """The structure whose poles and gains these are; it takes period and inputs from a segment."""
        shape = np.zeros((len(self.inputs), 3))
        return FreeFilter(STATES, [Segment(self.period_s, shape, np.zeros((1, 3)))])


def _modes(A: Array) -> Array:
    """The eigenvectors of a companion matrix [[0, 1], [a, b]], or real and imaginary part of one, as columns."""
    first, second = np.linalg.eigvals(A)
    if np.iscomplex(first):
        return np.array([[1.0, 0.0], [first.real, first.imag]])
    return np.array([[1.0, 1.0], [first.real, second.real]])
