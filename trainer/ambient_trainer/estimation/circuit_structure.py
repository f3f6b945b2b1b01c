"""A circuit as a separable structure: R, C and source shares are searched, weights and offsets solved for.

A segment starts from thermal equilibrium with its first sample where the ambient is estimated, and from any state where
nodes are predicted: each initial state is then one more linear unknown, whose regressor is its own decay.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits import Assembled, Circuit, Parameter, assemble
from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation.structure import LONGEST_STEP, Structure, Unknowns
from ambient_trainer.lti import StateSpace, discretised, passive_modes, response_slopes, states
from ambient_trainer.lti.response import response

_SLOWEST_PER_S = 1e-15


class CircuitStructure(Structure):
    """A circuit over segments; ``free_start`` says that they start anywhere, as in a forward simulation."""

    def __init__(self, circuit: Circuit, segments: Sequence[Segment]) -> None:
        self.circuit, self.segments = circuit, segments
        self.free_start = [output.column for output in circuit.outputs] != [REFERENCE]
        positive = {each.resistance for each in circuit.edges} | {each.capacitance for each in circuit.states}
        shares = {source.share for source in circuit.sources}
        read = ((*(each.states or {}).values(), *each.inputs.values(), each.offset) for each in circuit.outputs)
        weights = {name for names in read for name in names}
        free = [each for each in circuit.parameters if each.free]
        # what appears in outputs alone
        self.linear_parameters = [each for each in free if each.name in weights - positive - shares]
        searched = [each for each in free if each not in self.linear_parameters]
        self._logarithmic = np.array([each.name in positive for each in searched], dtype=bool)
        self.search = self._unknowns(searched, self._logarithmic)
        lasted = [(each.inputs.shape[1] * each.period_s, each.period_s) for each in segments]
        self._longest_s, self._shortest_s = max(lasted)[0], min(each for _, each in lasted)
        starts = [
            Parameter(f"start{index}_{node.name}", "degC", 0.0, -math.inf, math.inf, True)
            for index in range(len(segments) * self.free_start)
            for node in circuit.states
        ]
        unknowns = [*self.linear_parameters, *starts]
        self.linear = self._unknowns(unknowns, np.zeros(len(unknowns), dtype=bool))
        position = {each.name: index for index, each in enumerate(circuit.parameters)}
        self._order = [position[each.name] for each in (*searched, *self.linear_parameters)]
        self._last: tuple[bytes, Assembled] | None = None

    @staticmethod
    def _unknowns(parameters: Sequence[Parameter], logarithmic: NDArray[np.bool_]) -> Unknowns:
        table = np.array([(each.initial, each.low, each.high) for each in parameters]).reshape(-1, 3).T
        initial, low, high = np.where(logarithmic, np.log(np.where(logarithmic, table, 1.0)), table)
        names = tuple(each.name for each in parameters)
        return Unknowns(names, initial, low, high, np.where(logarithmic, LONGEST_STEP, math.inf))

    @property
    def logarithmic_names(self) -> tuple[str, ...]:
        """The unknowns whose logarithm is searched: resistances and capacitances."""
        return tuple(name for name, log in zip(self.search.names, self._logarithmic) if log)

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """Per mode, the logarithm by which its time constant exceeds the longest segment or undercuts a tenth period.

        The slope of a rate -lambda_i in a parameter is -(V^-1 dA V)_ii.
        """
        found = self._assembled(theta)
        eigenvalues, V, W = passive_modes(found.value.A, found.capacitance)
        # a circuit that has all but lost its way out has a rate of rounding, of either sign
        rates = np.maximum(-eigenvalues, _SLOWEST_PER_S)
        slopes = -np.einsum("in,knm,mi->ki", W, found.derivative.A[: len(theta)], V) / rates
        slow, fast = -np.log(rates * self._longest_s), np.log(rates * self._shortest_s / 10)
        penalty = np.concatenate([np.maximum(slow, 0.0), np.maximum(fast, 0.0)])
        jacobian = np.concatenate([np.where(slow > 0, -slopes, 0.0), np.where(fast > 0, slopes, 0.0)], axis=1)
        return penalty, jacobian.T

    def random_start(self, random: np.random.Generator) -> Array:
        """The initial values, each up to threefold off, with all heat capacities scaled together.

        The middle time constant lies log-uniformly between three periods and a tenth of the longest segment.
        """
        theta = self.search.initial + random.uniform(-1.1, 1.1, len(self.search.initial)) * self._logarithmic
        capacities = {node.capacitance for node in self.circuit.states}
        capacity = np.array([name in capacities for name in self.search.names], dtype=bool)
        if capacity.any():
            rates = np.diag(self._assembled(theta).value.A)
            low_s, high_s = 3 * self._shortest_s, max(self._longest_s / 10, 4 * self._shortest_s)
            wanted = math.exp(random.uniform(math.log(low_s), math.log(high_s)))
            theta[capacity] += math.log(wanted * float(np.exp(np.mean(np.log(-rates)))))
        return np.clip(theta, self.search.low, self.search.high)

    def values(self, theta: Array, beta: Array) -> dict[str, float]:
        """Every parameter of the circuit by name, at these unknowns."""
        found = {each.name: each.initial for each in self.circuit.parameters}
        physical = np.where(self._logarithmic, np.exp(np.where(self._logarithmic, theta, 0.0)), theta)
        found.update(zip(self.search.names, physical.tolist()))
        found.update(zip((each.name for each in self.linear_parameters), beta.tolist()))
        return found

    def system(self, theta: Array, beta: Array) -> StateSpace:
        """The continuous state space at these unknowns."""
        return assemble(self.circuit, self.values(theta, beta)).value

    def _assembled(self, theta: Array, beta: Array | None = None) -> Assembled:
        """The circuit, derivatives in theta first, then in the weights; by default with its linear unknowns at zero.

        That of the last theta is kept: every segment asks for it in turn.
        """
        if beta is None:
            if self._last is None or self._last[0] != theta.tobytes():
                self._last = theta.tobytes(), self._assembled(theta, np.zeros(len(self.linear_parameters)))
            return self._last[1]
        found = assemble(self.circuit, self.values(theta, beta))
        scale = np.ones(len(self._order))
        scale[: len(theta)] = np.exp(np.where(self._logarithmic, theta, 0.0))
        slopes = (
            each[self._order] * scale.reshape(-1, *[1] * (each.ndim - 1)) for each in vars(found.derivative).values()
        )
        return replace(found, derivative=StateSpace(*slopes))

    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """The response of the circuit without its weights, of what each of them reads, and the states' decays."""
        found, segment, q = self._assembled(theta), self.segments[index], len(self.circuit.outputs)
        value, weights = found.value, StateSpace(*(each[len(theta) :] for each in vars(found.derivative).values()))
        C, D, offset = (
            np.concatenate([getattr(value, name)[None], getattr(weights, name)]) for name in ("C", "D", "offset")
        )
        n, m = value.B.shape
        all_outputs = StateSpace(value.A, value.B, C.reshape(offset.size, n), D.reshape(offset.size, m), offset.ravel())
        rows = response(all_outputs, self.circuit.hold, segment.inputs, segment.period_s)
        rows = rows.reshape(-1, q, segment.inputs.shape[1])
        starts = np.zeros((len(self.linear.names) - len(weights.C), *rows.shape[1:]))
        if self.free_start:
            discrete = discretised(value, segment.period_s, self.circuit.hold)
            decays = states(discrete.A, np.zeros((n, n, rows.shape[-1])), np.eye(n))
            starts[index * n : (index + 1) * n] = np.tensordot(discrete.C, decays, 1).swapaxes(0, 1)
        return rows[0], np.concatenate([rows[1:], starts])

    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """The outputs' derivatives in theta, (P, q, N)."""
        segment, count, hold = self.segments[index], len(theta), self.circuit.hold
        found = self._assembled(theta, beta)
        by = StateSpace(*(each[:count] for each in vars(found.derivative).values()))
        n, weights = len(found.capacitance), len(self.linear_parameters)
        start = beta[weights + index * n : weights + (index + 1) * n] if self.free_start else np.zeros(n)
        u, period_s = segment.inputs, segment.period_s
        if not (self.free_start and weights):
            return response_slopes(found.value, by, hold, u, period_s, start)
        # what weights read is without the starts, which would not be linear any more
        still, unweighted = replace(by, offset=0 * by.offset), self._assembled(theta).value
        decayed = response_slopes(unweighted, still, hold, 0 * u, period_s, start)
        return response_slopes(found.value, by, hold, u, period_s) + decayed
