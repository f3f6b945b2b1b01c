"""A circuit as a structure: resistances, capacitances and source shares are searched, weights and offsets are solved.

In the modes of A = V diag(lambda) V^-1, a = exp(lambda T), the state is z = V xi with

    xi_i = sum_j (V^-1 Bd)_ij phi_ij,    phi_ij = u_j / (z - a_i),

and its derivative in a parameter is V times chi_ik = xi_k / (z - a_i), weighted by V^-1 dE V, plus phi, weighted by
V^-1 dBd. So n m + n^2 filters serve any number of parameters, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.assemble import Assembled, StateSpace, assemble
from ambient_trainer.circuits.circuit import Circuit, Parameter
from ambient_trainer.identify.discretise import discretised, discretised_slopes
from ambient_trainer.identify.modes import one_pole, passive_modes
from ambient_trainer.identify.structure import Expansion, Unknowns
from ambient_trainer.traces.grid import Segment

Array = NDArray[np.float64]

_SLOWEST_PER_S = 1e-15


class CircuitStructure:
    """A circuit over segments that start from thermal equilibrium with their first sample."""

    def __init__(self, circuit: Circuit, segments: Sequence[Segment]) -> None:
        self.circuit = circuit
        self.segments = segments
        self.linear_parameters = [
            each for each in circuit.parameters if each.free and each.name in _linear_names(circuit)
        ]
        self.searched = [each for each in circuit.parameters if each.free and each not in self.linear_parameters]
        self._logarithmic = np.array([each.name in _positive_names(circuit) for each in self.searched], dtype=bool)
        self.search = self._unknowns(self.searched, self._logarithmic)
        self.linear = self._unknowns(self.linear_parameters, np.zeros(len(self.linear_parameters), dtype=bool))
        self._position = {each.name: index for index, each in enumerate(circuit.parameters)}

    @staticmethod
    def _unknowns(parameters: Sequence[Parameter], logarithmic: NDArray[np.bool_]) -> Unknowns:
        def searched(values: Sequence[float]) -> Array:
            return np.array([math.log(x) if log else x for x, log in zip(values, logarithmic)], dtype=float)

        return Unknowns(
            tuple(each.name for each in parameters),
            searched([each.initial for each in parameters]),
            searched([each.low for each in parameters]),
            searched([each.high for each in parameters]),
        )

    @property
    def logarithmic_names(self) -> tuple[str, ...]:
        """The unknowns whose logarithm is searched: resistances and capacitances."""
        return tuple(name for name, log in zip(self.search.names, self._logarithmic) if log)

    def excess(self, theta: Array) -> tuple[Array, Array]:
        """Per mode, the logarithm by which its time constant exceeds the longest segment or undercuts a tenth period.

        Data of a day cannot tell a time constant of a year from none at all, and a mode without one is an integrator:
        its start means nothing and its error never ends. One that is gone before the next sample is no state.
        The slope of a rate -lambda_i in a parameter is -(V^-1 dA V)_ii.
        """
        found = self._assembled(theta)
        longest = max(segment.inputs.shape[1] * segment.period_s for segment in self.segments)
        shortest = min(segment.period_s for segment in self.segments) / 10
        eigenvalues, V, W = passive_modes(found.value.A, found.capacitance)
        # a circuit that has all but lost its way out has a rate of rounding, of either sign
        rates = np.maximum(-eigenvalues, _SLOWEST_PER_S)
        slopes = -np.einsum("in,knm,mi->ki", W, found.derivative.A[: len(theta)], V) / rates
        slow, fast = -np.log(rates * longest), np.log(rates * shortest)
        excess = np.concatenate([np.maximum(slow, 0.0), np.maximum(fast, 0.0)])
        jacobian = np.concatenate([np.where(slow > 0, -slopes, 0.0), np.where(fast > 0, slopes, 0.0)], axis=1)
        return excess, jacobian.T

    def regrouped(self, theta: Array) -> Array:
        """theta itself: a circuit's parameters have one meaning each."""
        return theta

    def random_start(self, random: np.random.Generator) -> Array:
        """The initial values, each up to threefold off, with all heat capacities scaled together.

        The common scale puts the circuit's middle time constant log-uniformly between three periods and a tenth of
        the longest segment: initial values of 1 J/K and 1 K/W say nothing about where it lies.
        """
        theta = self.search.initial + random.uniform(-1.1, 1.1, len(self.search.initial)) * self._logarithmic
        capacities = {node.capacitance for node in self.circuit.states}
        capacity = np.array([name in capacities for name in self.search.names], dtype=bool)
        if capacity.any():
            rates = np.diag(self._assembled(theta).value.A)
            longest = max(segment.inputs.shape[1] * segment.period_s for segment in self.segments)
            shortest = min(segment.period_s for segment in self.segments)
            wanted = math.exp(random.uniform(math.log(3 * shortest), math.log(max(longest / 10, 4 * shortest))))
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

    def _assembled(self, theta: Array) -> Assembled:
        """The circuit with its linear unknowns at zero; derivatives in theta first, then in beta."""
        weights = [each.name for each in self.linear_parameters]
        found = assemble(self.circuit, CircuitStructure.values(self, theta, np.zeros(len(weights))))
        scale = np.where(self._logarithmic, np.exp(np.where(self._logarithmic, theta, 0.0)), 1.0)
        order = [self._position[name] for name in (*self.search.names, *weights)]
        scale = np.concatenate([scale, np.ones(len(weights))])
        slopes = StateSpace(
            *(
                matrix[order] * scale.reshape(-1, *[1] * (matrix.ndim - 1))
                for matrix in (getattr(found.derivative, name) for name in ("A", "B", "C", "D", "offset"))
            )
        )
        return replace(found, derivative=slopes)

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """The outputs and their derivatives in terms of :meth:`signals`."""
        found = self._assembled(theta)
        hold = self.circuit.hold
        value = discretised(found.value, period_s, hold)
        slope = discretised_slopes(found.value, found.derivative, period_s, hold)
        _, V, W = passive_modes(found.value.A, found.capacitance)
        count = len(theta)
        drive, gain = W @ value.B, value.C @ V
        fixed = self._pack(value.D, value.offset, gain[:, :, None] * drive, None)
        gain_slope, drive_slope = slope.C @ V, W @ slope.B
        whole = self._pack(
            slope.D,
            slope.offset,
            gain_slope[..., None] * drive + gain[:, :, None] * drive_slope[:, None],
            gain[:, :, None] * (W @ slope.A @ V)[:, None],
        )
        free = np.moveaxis(whole[count:], 0, -1)
        return Expansion(fixed, free, whole[:count], self._free_slope(found, slope, theta, period_s, V, W, drive))

    def _free_slope(
        self, found: Assembled, slope: StateSpace, theta: Array, period_s: float, V: Array, W: Array, drive: Array
    ) -> Array:
        """d/dtheta of each linear unknown's regressor, found as the slope of a system whose C, D are that unknown's."""
        count, outputs = len(theta), len(self.circuit.outputs)
        p = len(self.linear_parameters)
        size = self._size
        result = np.zeros((count, outputs, size, p))
        for index in range(p):
            unit = StateSpace(
                found.value.A,
                found.value.B,
                found.derivative.C[count + index],
                found.derivative.D[count + index],
                found.derivative.offset[count + index],
            )
            if not unit.C.any():
                continue
            still = StateSpace(
                found.derivative.A[:count],
                found.derivative.B[:count],
                np.zeros((count, *unit.C.shape)),
                np.zeros((count, *unit.D.shape)),
                np.zeros((count, outputs)),
            )
            moved = discretised_slopes(unit, still, period_s, self.circuit.hold)
            gain = discretised(unit, period_s, self.circuit.hold).C @ V
            result[..., index] = self._pack(
                moved.D,
                moved.offset,
                (moved.C @ V)[..., None] * drive + gain[:, :, None] * (W @ moved.B)[:, None],
                gain[:, :, None] * (W @ moved.A @ V)[:, None],
            )
        return result

    @property
    def _size(self) -> int:
        n, m = len(self.circuit.states), len(self.circuit.inputs)
        return m + 1 + n * m + n * n

    def _pack(self, direct: Array, offset: Array, phi: Array, chi: Array | None) -> Array:
        """Coefficients (..., q, s) in the order of the signals: inputs, one, phi, chi."""
        lead = direct.shape[:-1]
        n = len(self.circuit.states)
        last = np.zeros((*lead, n * n)) if chi is None else chi.reshape(*lead, -1)
        return np.concatenate([direct, offset[..., None], phi.reshape(*lead, -1), last], axis=-1)

    def signals(self, theta: Array, index: int) -> Array:
        """The inputs, one, phi (n m rows) and chi (n^2 rows) of a segment."""
        segment = self.segments[index]
        found = self._assembled(theta)
        value = discretised(found.value, segment.period_s, self.circuit.hold)
        rates, _, W = passive_modes(found.value.A, found.capacitance)
        poles = np.exp(rates * segment.period_s)
        u = segment.inputs
        drive = W @ value.B
        phi = [one_pole(a, u, u[:, 0] / (1 - a)) for a in poles]
        xi = np.array([row @ each for row, each in zip(drive, phi)]).reshape(-1, u.shape[1])
        chi = [one_pole(a, xi, xi[:, 0] / (1 - a)) for a in poles]
        return np.concatenate([u, np.ones((1, u.shape[1])), *phi, *chi])


def _positive_names(circuit: Circuit) -> set[str]:
    return {node.capacitance for node in circuit.states if node.capacitance} | {
        edge.resistance for edge in circuit.edges
    }


def _linear_names(circuit: Circuit) -> set[str]:
    """The parameters that appear in outputs alone."""
    outputs = circuit.outputs
    weights = {name for output in outputs for name in ((output.states or {}).values())}
    weights |= {name for output in outputs for name in output.inputs.values()}
    weights |= {output.offset for output in outputs if output.offset is not None}
    return weights - _positive_names(circuit) - {source.share for source in circuit.sources}
