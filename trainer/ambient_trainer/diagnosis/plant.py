"""The circuit as a simulation: what heat in any node does to every node, exactly, by modal filters.

In the modes of A = V diag(lambda) W, heat q into node i moves mode m by

    xi_m' = lambda_m xi_m + W_mi q / C_i,    T = V xi,

and each mode is a one-pole filter of straight lines between samples (first-order hold).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.lti.lag import lag_weights
from ambient_trainer.lti.modes import modal_response, passive_modes

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """A circuit in forward form at known parameter ``values``, sampled every ``period_s``.

    n states, m inputs, s sensors; ``reads`` (s,) is the state that each sensor reads.
    """

    circuit: Circuit
    values: Mapping[str, float]
    period_s: float
    A: Array
    B: Array
    capacitance: Array
    reads: NDArray[np.intp]
    rates: Array
    V: Array
    W: Array

    @staticmethod
    def of(circuit: Circuit, values: Mapping[str, float], period_s: float) -> Plant:
        """The plant of a forward circuit."""
        found = assemble(circuit, values)
        rates, V, W = passive_modes(found.value.A, found.capacitance)
        names = [node.name for node in circuit.states]
        reads = [names.index(next(iter(output.states or ()))) for output in circuit.outputs]
        return Plant(
            circuit,
            values,
            period_s,
            found.value.A,
            found.value.B,
            found.capacitance,
            np.array(reads, dtype=np.intp),
            np.minimum(rates, -1e-12),
            V,
            W,
        )

    def with_losses(self, conductance_W_K: Array) -> Plant:
        """The plant whose every node also gives off ``conductance_W_K`` (n,) per degree of its own."""
        A = self.A - np.diag(conductance_W_K / self.capacitance)
        rates, V, W = passive_modes(A, self.capacitance)
        return replace(self, A=A, rates=np.minimum(rates, -1e-12), V=V, W=W)

    def part(self, chosen: NDArray[np.bool_]) -> Plant:
        """Some of the states, the others being boundaries; its B and sensors are not theirs."""
        A, capacitance = self.A[np.ix_(chosen, chosen)], self.capacitance[chosen]
        rates, V, W = passive_modes(A, capacitance)
        return replace(self, A=A, capacitance=capacitance, rates=np.minimum(rates, -1e-12), V=V, W=W)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The names of the states."""
        return tuple(node.name for node in self.circuit.states)

    @property
    def sensors(self) -> tuple[str, ...]:
        """The names of the sensors."""
        return tuple(output.name for output in self.circuit.outputs)

    def modal_weights(self) -> tuple[Array, Array, Array]:
        """Per mode: a = exp(lambda T), and the shares of a sample and of the next in the first-order hold."""
        kept, before, now = lag_weights(-1 / self.rates, self.period_s)
        return kept, -before / self.rates, -now / self.rates

    def modal(self, drive: Array) -> Array:
        """Modal states (..., n, N) that start at rest, under ``drive`` (..., n, N): each mode's input in K/s."""
        return modal_response(self.rates, drive, self.period_s, 0.0)

    def respond(self, node: int, heat_W: Array) -> Array:
        """All nodes (n, N) from rest under ``heat_W`` (N,) into one node."""
        return np.asarray(self.V @ self.modal(self.W[:, node, None] / self.capacitance[node] * heat_W))

    def forced(self, inputs: Array) -> Array:
        """All nodes (n, N) from rest (all states at zero) under the circuit's own ``inputs`` (m, N)."""
        return np.asarray(self.V @ self.modal(self.W @ self.B @ inputs))

    def modal_decay(self, samples: int) -> Array:
        """What is left of one in each mode, (n, N)."""
        return np.asarray(np.exp(np.outer(self.rates * self.period_s, np.arange(samples))))

    def decays(self, samples: int) -> Array:
        """What each initial state leaves in each node, (n initial, n nodes, N)."""
        return np.einsum("im,mj,mk->jik", self.V, self.W, self.modal_decay(samples))
