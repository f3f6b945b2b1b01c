"""One function makes the continuous A, B, C, D of a circuit, and their derivatives in every parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import AMBIENT, Circuit, Output
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.statespace import StateSpace


@dataclass(frozen=True)
class Assembled:
    """A state space, its derivative in each parameter (a leading axis), and the heat capacities in J/K (n,)."""

    value: StateSpace
    derivative: StateSpace
    capacitance: Array


def assemble(circuit: Circuit, values: Mapping[str, float]) -> Assembled:
    """The state space of ``circuit`` with its parameters at ``values``; derivatives in the order of its parameters.

    Node i balances C_i dT_i/dt = sum_j (T_j - T_i)/R_ij + sum_s share_s signal_s. In ``rise`` form T_j - T_i is taken
    from the inputs and the loss is -x_i/R_i,ambient (thesis equation 4.5, the sign of row 2 as in erratum 1); in
    ``temperature`` form an edge to an ambient that no sensor prescribes carries no heat (erratum 10).
    """
    if circuit.mechanisms:
        kinds = ", ".join(each.kind for each in circuit.mechanisms)
        hint = "simulate it with `diagnose`, or take the circuit without its mechanisms"
        raise refuse(circuit.name, "mechanisms", f"no linear state space holds {kinds}", hint)
    return _Assembly(circuit, values).result()


class _Assembly:
    def __init__(self, circuit: Circuit, values: Mapping[str, float]) -> None:
        self.circuit = circuit
        self.values = values
        self.parameter = {parameter.name: index for index, parameter in enumerate(circuit.parameters)}
        self.state = {node.name: index for index, node in enumerate(circuit.states)}
        self.input = {column: index for index, column in enumerate(circuit.inputs)}
        self.column = {node.name: f"{node.sensor}_degC" for node in circuit.nodes if node.sensor}
        n, m, q = len(self.state), len(self.input), len(circuit.outputs)
        count = len(self.parameter)
        self.value = StateSpace(*_zeros((n, n), (n, m), (q, n), (q, m), (q,)))
        self.derivative = StateSpace(*_zeros((count, n, n), (count, n, m), (count, q, n), (count, q, m), (count, q)))

    def result(self) -> Assembled:
        for row, node in enumerate(self.circuit.states):
            for edge in self.circuit.edges:
                if node.name in edge.between:
                    self._exchange(row, node.name, edge.other(node.name), str(node.capacitance), edge.resistance)
            for source in self.circuit.sources:
                if source.into == node.name:
                    self._source(row, str(node.capacitance), source.share, self.input[source.signal])
        for row, output in enumerate(self.circuit.outputs):
            self._output(row, output)
        capacitance = np.array([self.values[str(node.capacitance)] for node in self.circuit.states])
        return Assembled(self.value, self.derivative, capacitance)

    def _add(self, matrix: str, place: tuple[int, ...], value: float, gradient: Mapping[str, float]) -> None:
        getattr(self.value, matrix)[place] += value
        for name, slope in gradient.items():
            getattr(self.derivative, matrix)[self.parameter[name]][place] += slope

    def _exchange(self, row: int, node: str, other: str, capacitance: str, resistance: str) -> None:
        C, R = self.values[capacitance], self.values[resistance]
        rate = 1 / (C * R)
        gradient = {capacitance: -rate / C, resistance: -rate / R}
        loss = {name: -slope for name, slope in gradient.items()}
        if self.circuit.form == "rise":
            if other == AMBIENT:
                self._add("A", (row, row), -rate, loss)
                return
            self._add("B", (row, self.input[self.column[other]]), rate, gradient)
            self._add("B", (row, self.input[self.column[node]]), -rate, loss)
            return
        if other in self.state:
            self._add("A", (row, self.state[other]), rate, gradient)
        elif other in self.column:
            self._add("B", (row, self.input[self.column[other]]), rate, gradient)
        else:
            return
        self._add("A", (row, row), -rate, loss)

    def _source(self, row: int, capacitance: str, share: str, column: int) -> None:
        C, gain = self.values[capacitance], self.values[share]
        self._add("B", (row, column), gain / C, {share: 1 / C, capacitance: -gain / C**2})

    def _output(self, row: int, output: Output) -> None:
        if output.states is None:
            self._shares_of_conductance(row)
        else:
            for node, name in output.states.items():
                self._add("C", (row, self.state[node]), self.values[name], {name: 1.0})
        for column, name in output.inputs.items():
            self._add("D", (row, self.input[column]), self.values[name], {name: 1.0})
        if output.offset is not None:
            self._add("offset", (row,), self.values[output.offset], {output.offset: 1.0})
        if output.heat is not None:
            self._balance_of_ambient(row, output.heat)

    def _shares_of_conductance(self, row: int) -> None:
        """Row of C by the nodes' conductances to the ambient: G_i / sum G, negative for rises (equation 4.11)."""
        sign = -1.0 if self.circuit.form == "rise" else 1.0
        to_ambient = self.circuit.to_ambient(self.circuit.states)
        for node, name in to_ambient:
            R = self.values[name]
            self._over_conductance("C", (row, self.state[node]), sign / R, {name: -sign / R**2}, to_ambient)

    def _balance_of_ambient(self, row: int, heat: str) -> None:
        """Row of D and offset where the ambient balances the measured nodes' heat and ``heat`` (equation 4.4)."""
        to_ambient = self.circuit.to_ambient(self.circuit.measured)
        for node, name in to_ambient:
            R = self.values[name]
            place = (row, self.input[self.column[node]])
            self._over_conductance("D", place, 1 / R, {name: -1 / R**2}, to_ambient)
        self._over_conductance("offset", (row,), self.values[heat], {heat: 1.0}, to_ambient)

    def _over_conductance(
        self,
        matrix: str,
        place: tuple[int, ...],
        numerator: float,
        gradient: Mapping[str, float],
        to_ambient: Sequence[tuple[str, str]],
    ) -> None:
        """Add ``numerator`` / S with S = sum 1/R_i, whose slope in R_k is -1/R_k^2 for each edge with that R_k."""
        total = sum(1 / self.values[name] for _, name in to_ambient)
        self._add(matrix, place, numerator / total, {name: slope / total for name, slope in gradient.items()})
        for _, name in to_ambient:
            self._add(matrix, place, 0.0, {name: numerator / (total * self.values[name]) ** 2})


def _zeros(*shapes: tuple[int, ...]) -> list[Array]:
    return [np.zeros(shape) for shape in shapes]
