"""A circuit as a structure: resistances, capacitances and source shares are searched, weights and offsets are solved.

In the modes of A = V diag(lambda) V^-1, a = exp(lambda T), the state is z = V xi with

    xi_i = sum_j (V^-1 Bd)_ij phi_ij,    phi_ij = u_j / (z - a_i),

and its derivative in a parameter is V times chi_ik = xi_k / (z - a_i), weighted by V^-1 dE V, plus phi, weighted by
V^-1 dBd. Modes that lie apart make their chi_ik of phi. So n m + n filters serve any number of parameters, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.assemble import Assembled, assemble
from ambient_trainer.circuits.circuit import Circuit, Parameter
from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.structure import Expansion, Unknowns
from ambient_trainer.lti.discretise import discretised, discretised_slopes
from ambient_trainer.lti.modes import Pairs, one_pole, passive_modes
from ambient_trainer.lti.statespace import Hold, StateSpace

_SLOWEST_PER_S = 1e-15
_KEPT = 4


@dataclass(frozen=True)
class Modal:
    """A discretised circuit in its modes, with derivatives in theta first, then in beta."""

    assembled: Assembled
    value: StateSpace
    slope: StateSpace
    poles: Array
    V: Array
    W: Array
    drive: Array
    """W Bd (n, m)"""
    pairs: Pairs

    @staticmethod
    def of(assembled: Assembled, period_s: float, hold: Hold) -> Modal:
        """The modes of a circuit, sampled."""
        value = discretised(assembled.value, period_s, hold)
        slope = discretised_slopes(assembled.value, assembled.derivative, period_s, hold)
        rates, V, W = passive_modes(assembled.value.A, assembled.capacitance)
        poles = np.exp(rates * period_s)
        return Modal(assembled, value, slope, poles, V, W, W @ value.B, Pairs.of(poles))

    @property
    def size(self) -> int:
        """The number of signals: inputs, one, phi and chi."""
        n, m = self.drive.shape
        return m + 1 + n * m + self.pairs.count

    @property
    def decays(self) -> int:
        """The number of signals that a free start adds."""
        return len(self.poles) + self.pairs.count

    def packed(self, direct: Array, offset: Array, phi: Array, chi: Array | None) -> Array:
        """Coefficients (..., q, s) in the order of the signals: inputs, one, phi, chi."""
        lead = direct.shape[:-1]
        if chi is None:
            last = np.zeros((*lead, self.pairs.count))
        else:
            last, quotients = self.pairs.parted(chi)
            phi = phi + quotients @ self.drive - quotients.sum(axis=-2)[..., None] * self.drive
        return np.concatenate([direct, offset[..., None], phi.reshape(*lead, -1), last], axis=-1)


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
        self._modal: dict[tuple[bytes, float], Modal] = {}

    @staticmethod
    def _unknowns(parameters: Sequence[Parameter], logarithmic: NDArray[np.bool_]) -> Unknowns:
        table = np.array([(each.initial, each.low, each.high) for each in parameters]).reshape(-1, 3).T
        scaled = np.where(logarithmic, np.log(np.where(logarithmic, table, 1.0)), table)
        return Unknowns(tuple(each.name for each in parameters), *scaled)

    @property
    def logarithmic_names(self) -> tuple[str, ...]:
        """The unknowns whose logarithm is searched: resistances and capacitances."""
        return tuple(name for name, log in zip(self.search.names, self._logarithmic) if log)

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """Per mode, the logarithm by which its time constant exceeds the longest segment or undercuts a tenth period.

        Data of a day do not distinguish a time constant of a year from none, and a mode without one is an integrator:
        its start means nothing and its error never ends. One that is gone before the next sample is no state.
        The slope of a rate -lambda_i in a parameter is -(V^-1 dA V)_ii.
        """
        found = self._at(theta, self.segments[0].period_s).assembled
        longest = max(segment.inputs.shape[1] * segment.period_s for segment in self.segments)
        shortest = min(segment.period_s for segment in self.segments) / 10
        eigenvalues, V, W = passive_modes(found.value.A, found.capacitance)
        # a circuit that has all but lost its way out has a rate of rounding, of either sign
        rates = np.maximum(-eigenvalues, _SLOWEST_PER_S)
        slopes = -np.einsum("in,knm,mi->ki", W, found.derivative.A[: len(theta)], V) / rates
        slow, fast = -np.log(rates * longest), np.log(rates * shortest)
        penalty = np.concatenate([np.maximum(slow, 0.0), np.maximum(fast, 0.0)])
        jacobian = np.concatenate([np.where(slow > 0, -slopes, 0.0), np.where(fast > 0, slopes, 0.0)], axis=1)
        return penalty, jacobian.T

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

    def _at(self, theta: Array, period_s: float) -> Modal:
        """The modes at ``theta``; those of the last places are kept, signals and expansion being asked for in turn."""
        key = (theta.tobytes(), period_s)
        if key not in self._modal:
            if len(self._modal) >= _KEPT:
                self._modal.pop(next(iter(self._modal)))
            self._modal[key] = Modal.of(self._assembled(theta), period_s, self.circuit.hold)
        return self._modal[key]

    def _assembled(self, theta: Array) -> Assembled:
        """The circuit with its linear unknowns at zero; derivatives in theta first, then in beta."""
        weights = [each.name for each in self.linear_parameters]
        found = assemble(self.circuit, CircuitStructure.values(self, theta, np.zeros(len(weights))))
        scale = np.append(np.exp(np.where(self._logarithmic, theta, 0.0)), np.ones(len(weights)))
        order = [self._position[name] for name in (*self.search.names, *weights)]
        matrices = ((name, matrix[order]) for name, matrix in vars(found.derivative).items())
        slopes = {name: matrix * scale.reshape(-1, *[1] * (matrix.ndim - 1)) for name, matrix in matrices}
        return replace(found, derivative=StateSpace(**slopes))

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """The outputs and their derivatives in terms of :meth:`signals`."""
        at = self._at(theta, period_s)
        value, slope, count = at.value, at.slope, len(theta)
        gain = value.C @ at.V
        fixed = at.packed(value.D, value.offset, gain[:, :, None] * at.drive, None)
        gain_slope, drive_slope = slope.C @ at.V, at.W @ slope.B
        whole = at.packed(
            slope.D,
            slope.offset,
            gain_slope[..., None] * at.drive + gain[:, :, None] * drive_slope[:, None],
            gain[:, :, None] * (at.W @ slope.A @ at.V)[:, None],
        )
        free = np.moveaxis(whole[count:], 0, -1)
        return Expansion(fixed, free, whole[:count], self._free_slope(at, theta, period_s, fixed.shape[-1]))

    def _free_slope(self, at: Modal, theta: Array, period_s: float, size: int) -> Array:
        """d/dtheta of each linear unknown's regressor, found as the slope of a system whose C, D are that unknown's."""
        found, slope = at.assembled, at.assembled.derivative
        count, outputs = len(theta), len(self.circuit.outputs)
        result = np.zeros((count, outputs, size, len(self.linear_parameters)))
        for index in range(len(self.linear_parameters)):
            C, D, offset = (getattr(slope, name)[count + index] for name in ("C", "D", "offset"))
            if not C.any():
                continue
            unit = StateSpace(found.value.A, found.value.B, C, D, offset)
            still = StateSpace(
                slope.A[:count], slope.B[:count], *(np.zeros((count, *each.shape)) for each in (C, D, offset))
            )
            moved = discretised_slopes(unit, still, period_s, self.circuit.hold)
            gain = discretised(unit, period_s, self.circuit.hold).C @ at.V
            result[..., index] = at.packed(
                moved.D,
                moved.offset,
                (moved.C @ at.V)[..., None] * at.drive + gain[:, :, None] * (at.W @ moved.B)[:, None],
                gain[:, :, None] * (at.W @ moved.A @ at.V)[:, None],
            )
        return result

    def signals(self, theta: Array, index: int) -> Array:
        """The inputs, one, phi (n m rows), and chi of the pairs of modes that need one, of a segment."""
        at, u = self._at(theta, self.segments[index].period_s), self.segments[index].inputs
        n, m = at.drive.shape
        result = np.empty((at.size, u.shape[1]))
        result[:m], result[m] = u, 1.0
        phi = result[m + 1 : m + 1 + n * m].reshape(n, m, u.shape[1])
        for mode, a in enumerate(at.poles):
            phi[mode] = one_pole(a, u, u[:, 0] / (1 - a))
        for row, i, k in zip(result[m + 1 + n * m :], *np.nonzero(at.pairs.own)):
            xi = at.drive[k] @ phi[k]
            row[:] = one_pole(at.poles[i], xi[None], xi[:1] / (1 - at.poles[i]))[0]
        return result


def _positive_names(circuit: Circuit) -> set[str]:
    return {node.capacitance for node in circuit.states if node.capacitance} | {
        edge.resistance for edge in circuit.edges
    }


def _linear_names(circuit: Circuit) -> set[str]:
    """The parameters that appear in outputs alone."""
    outputs = circuit.outputs
    weights = {name for each in outputs for name in (*(each.states or {}).values(), *each.inputs.values(), each.offset)}
    return (
        {name for name in weights if name is not None}
        - _positive_names(circuit)
        - {source.share for source in circuit.sources}
    )
