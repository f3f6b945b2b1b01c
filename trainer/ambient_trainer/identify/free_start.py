"""A circuit whose segments start anywhere: each initial state is one more linear unknown, solved for exactly.

A deviation delta from the equilibrium start adds sum_i (W delta)_i a_i^k in mode i; its derivative in a parameter
needs a_k^. / (z - a_i) besides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.identify.circuit_structure import CircuitStructure
from ambient_trainer.identify.discretise import discretised, discretised_slopes
from ambient_trainer.identify.modes import one_pole, passive_modes
from ambient_trainer.identify.structure import Expansion, Unknowns
from ambient_trainer.traces.grid import Segment

Array = NDArray[np.float64]


class FreelyStartingCircuit(CircuitStructure):
    """A circuit over segments with an unknown initial state each, as in a forward simulation of measured nodes."""

    def __init__(self, circuit: Circuit, segments: Sequence[Segment]) -> None:
        super().__init__(circuit, segments)
        names = [f"start{index}_{node.name}" for index in range(len(segments)) for node in circuit.states]
        self._weights = self.linear
        free = np.full(len(names), np.inf)
        self.linear = Unknowns(
            (*self._weights.names, *names),
            np.concatenate([self._weights.initial, np.zeros(len(names))]),
            np.concatenate([self._weights.low, -free]),
            np.concatenate([self._weights.high, free]),
        )

    def values(self, theta: Array, beta: Array) -> dict[str, float]:
        """Every parameter of the circuit by name; the initial states are none of them."""
        return super().values(theta, beta[: len(self._weights.names)])

    @property
    def _decays(self) -> int:
        n = len(self.circuit.states)
        return n + n * n

    def signals(self, theta: Array, index: int) -> Array:
        """The circuit's signals, then per segment its decays a_i^k and a_k^. / (z - a_i), zero in the others."""
        segment = self.segments[index]
        found = self._assembled(theta)
        rates, _, _ = passive_modes(found.value.A, found.capacitance)
        count = segment.inputs.shape[1]
        decay = np.exp(np.outer(rates * segment.period_s, np.arange(count)))
        slopes = [one_pole(a, decay, np.zeros(len(rates))) for a in np.exp(rates * segment.period_s)]
        rows = np.zeros((len(self.segments) * self._decays, count))
        rows[index * self._decays : (index + 1) * self._decays] = np.concatenate([decay, *slopes])
        return np.concatenate([super().signals(theta, index), rows])

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """The circuit's expansion with the initial states' regressors beside it."""
        base = super().expand(theta, period_s)
        found = self._assembled(theta)
        hold = self.circuit.hold
        value = discretised(found.value, period_s, hold)
        slope = discretised_slopes(found.value, found.derivative, period_s, hold)
        _, V, W = passive_modes(found.value.A, found.capacitance)
        count, n, segments = len(theta), len(V), len(self.segments)
        gain = value.C @ V
        own = np.zeros((len(gain), self._decays, n))
        own[:, :n] = gain[:, :, None] * W
        moved = np.zeros((count, len(gain), self._decays, n))
        moved[:, :, :n] = (slope.C[:count] @ V)[..., None] * W
        turned = (W @ slope.A[:count] @ V)[:, None, :, :, None] * W
        moved[:, :, n:] = (gain[:, :, None, None] * turned).reshape(count, len(gain), n * n, n)
        return Expansion(
            _grown(base.fixed, segments * self._decays),
            _beside(base.free, own, segments),
            _grown(base.fixed_slope, segments * self._decays),
            _beside(base.free_slope, moved, segments),
        )


def _grown(coefficients: Array, more: int) -> Array:
    return np.concatenate([coefficients, np.zeros((*coefficients.shape[:-1], more))], axis=-1)


def _beside(weights: Array, starts: Array, segments: int) -> Array:
    """Block-diagonal in the last two axes: the weights' regressors, then each segment's."""
    lead = weights.shape[:-2]
    s, p = weights.shape[-2:]
    d, n = starts.shape[-2:]
    result = np.zeros((*lead, s + segments * d, p + segments * n))
    result[..., :s, :p] = weights
    for index in range(segments):
        result[..., s + index * d : s + (index + 1) * d, p + index * n : p + (index + 1) * n] = starts
    return result
