"""Assembly of the continuous A, B, C, D of a circuit, and their derivatives with respect to every parameter.

Derivatives are complex steps (Squire and Trapp 1998, SIAM Rev. 40(1)): with p + ih in the place of p the imaginary part
of a matrix is h times its derivative in p, to the last digit, since nothing is subtracted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import AMBIENT, Circuit, Edge, Node, Output
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.statespace import StateSpace

_STEP = 1e-100


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
    names = [each.name for each in circuit.parameters]
    # the first of the stack is the circuit itself; each other one steps one parameter
    steps = np.eye(len(names) + 1, len(names), k=-1) * _STEP * 1j
    stack = _Assembly(circuit, dict(zip(names, (steps + [values[name] for name in names]).T))).result()
    return Assembled(
        StateSpace(*(each[0].real.copy() for each in stack)),
        StateSpace(*(each[1:].imag / _STEP for each in stack)),
        np.array([values[str(node.capacitance)] for node in circuit.states]),
    )


class _Assembly:
    """The matrices of a stack of circuits that differ in their parameters ``p`` (count,)."""

    def __init__(self, circuit: Circuit, p: Mapping[str, NDArray[np.complex128]]) -> None:
        self.circuit, self.p = circuit, p
        self.state = {node.name: index for index, node in enumerate(circuit.states)}
        self.input = {column: index for index, column in enumerate(circuit.inputs)}
        self.read = {node.name: self.input.get(f"{node.sensor}_degC", -1) for node in circuit.nodes if node.sensor}
        n, m, q = len(self.state), len(self.input), len(circuit.outputs)
        shapes = ((n, n), (n, m), (q, n), (q, m), (q,))
        self.A, self.B, self.C, self.D, self.offset = (np.zeros((len(p) + 1, *each), complex) for each in shapes)

    def result(self) -> tuple[NDArray[np.complex128], ...]:
        for row, node in enumerate(self.circuit.states):
            for edge in self.circuit.edges:
                if node.name in edge.between:
                    self._exchange(row, node, edge)
            for source in self.circuit.sources:
                if source.into == node.name:
                    self.B[:, row, self.input[source.signal]] += self.p[source.share] / self.p[str(node.capacitance)]
        for row, output in enumerate(self.circuit.outputs):
            self._output(row, output)
        return self.A, self.B, self.C, self.D, self.offset

    def _exchange(self, row: int, node: Node, edge: Edge) -> None:
        rate = 1 / (self.p[str(node.capacitance)] * self.p[edge.resistance])
        other = edge.other(node.name)
        if self.circuit.form == "rise" and other != AMBIENT:
            self.B[:, row, self.read[other]] += rate
            self.B[:, row, self.read[node.name]] -= rate
            return
        if other in self.state:
            self.A[:, row, self.state[other]] += rate
        elif other in self.read:
            self.B[:, row, self.read[other]] += rate
        elif self.circuit.form == "temperature":
            return
        self.A[:, row, row] -= rate

    def _output(self, row: int, output: Output) -> None:
        if output.states is None:  # shares of the conductance to the ambient (equation 4.11), negative for rises
            conductances = self._to_ambient(self.circuit.states)
            total = sum(G for _, G in conductances) * (-1.0 if self.circuit.form == "rise" else 1.0)
            for name, G in conductances:
                self.C[:, row, self.state[name]] += G / total
        for name, weight in (output.states or {}).items():
            self.C[:, row, self.state[name]] += self.p[weight]
        for column, weight in output.inputs.items():
            self.D[:, row, self.input[column]] += self.p[weight]
        if output.offset is not None:
            self.offset[:, row] += self.p[output.offset]
        if output.heat is not None:  # the ambient balances the measured nodes' heat and this one (equation 4.4)
            conductances = self._to_ambient(self.circuit.measured)
            total = sum(G for _, G in conductances)
            for name, G in conductances:
                self.D[:, row, self.read[name]] += G / total
            self.offset[:, row] += self.p[output.heat] / total

    def _to_ambient(self, nodes: Sequence[Node]) -> list[tuple[str, NDArray[np.complex128]]]:
        """The conductance of each edge between one of ``nodes`` and the ambient."""
        return [(name, 1 / self.p[resistance]) for name, resistance in self.circuit.to_ambient(nodes)]
