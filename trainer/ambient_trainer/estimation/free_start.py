"""A circuit whose segments start anywhere: each initial state is one more linear unknown, solved for exactly.

A deviation delta from the equilibrium start adds sum_i (W delta)_i a_i^k in mode i; its derivative in a parameter
needs a_k^. / (z - a_i) besides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.structure import Expansion, Unknowns
from ambient_trainer.lti.modes import one_pole

_NOTHING = 1e-150


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

    def signals(self, theta: Array, index: int) -> Array:
        """The circuit's signals, then per segment a_i^k and a_k^. / (z - a_i) of pairs, zero in the others."""
        at = self._at(theta, self.segments[index].period_s)
        n, steps = len(at.poles), np.arange(float(self.segments[index].inputs.shape[1]))
        starts = np.zeros((len(self.segments), at.decays, len(steps)))
        rows = starts[index]
        decay = rows[:n]
        # of the poles as they were rounded, for the sake of differences of powers
        np.exp(np.outer(np.log(np.maximum(at.poles, _NOTHING)), steps), out=decay)
        # arithmetic takes ten times as long with numbers that are all but zero
        decay[decay < _NOTHING] = 0.0
        for row, i, k in zip(rows[n:], *np.nonzero(at.pairs.own)):
            if i == k:
                np.multiply(decay[k, :-1], steps[1:], out=row[1:])
            else:
                row[:] = one_pole(at.poles[i], decay[k, None], np.zeros(1))[0]
        return np.concatenate([super().signals(theta, index), starts.reshape(-1, len(steps))])

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """The circuit's expansion with the initial states' regressors beside it."""
        base = super().expand(theta, period_s)
        at = self._at(theta, period_s)
        slope, count, n, segments = at.slope, len(theta), len(at.poles), len(self.segments)
        gain = at.value.C @ at.V
        series, quotients = at.pairs.parted(gain[:, :, None] * (at.W @ slope.A[:count] @ at.V)[:, None])
        own = np.zeros((len(gain), at.decays, n))
        own[:, :n] = gain[:, :, None] * at.W
        moved = np.zeros((count, len(gain), at.decays, n))
        moved[:, :, :n] = (slope.C[:count] @ at.V)[..., None] * at.W
        moved[:, :, :n] += quotients @ at.W - quotients.sum(axis=-2)[..., None] * at.W
        _, source = np.nonzero(at.pairs.own)
        moved[:, :, n:] = series[..., None] * at.W[source]
        return Expansion(
            _grown(base.fixed, segments * at.decays),
            _beside(base.free, own, segments),
            _grown(base.fixed_slope, segments * at.decays),
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
