"""The estimator of a circuit: its resistances, capacitances and weights are the unknowns of the search."""

from __future__ import annotations

from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import USUAL, Effort, Estimator, Fit
from ambient_trainer.estimators.searched import estimated, fit_of, searched
from ambient_trainer.estimators.training import require_enough, source_of, training_segments


class CircuitEstimator(Estimator):
    """Fits a circuit, each stretch from thermal equilibrium with its first sample; it names its trace columns."""

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.name = circuit.name

    def fit(
        self,
        traces: Sequence[Trace],
        effort: Effort = USUAL,
        progress: Progress | None = None,
        period_s: float | None = None,
        inputs: Sequence[str] | None = None,
    ) -> Fit:
        """Fit; see :meth:`ambient_trainer.estimators.base.Estimator.fit`.

        Raises :class:`Refused` where the traces lack a column, hold too little, or an input never changes.
        """
        columns = tuple(output.column for output in self.circuit.outputs)
        data = training_segments(traces, self.circuit.inputs, columns, period_s, effort.pieces)
        structure = circuit_structure(self.circuit, data)
        require_enough(source_of(traces), structure)
        with threadpool_limits(1):
            found = searched(structure, effort, progress)
            best = found.result.best
            values = structure.values(best.theta, best.beta)
            units = {each.name: each.unit for each in self.circuit.parameters}
            logarithmic = structure.logarithmic_names
            # what the file gives as a bare number has a place for a name, with dots in it
            shown = [each.name for each in self.circuit.parameters if each.free or "." not in each.name]
            return fit_of(
                found,
                structure.system(best.theta, best.beta),
                [estimated(name, units[name], values[name], name in logarithmic, found.known) for name in shown],
                circuit=self.circuit.name,
                inputs=self.circuit.inputs,
                states=[node.name for node in self.circuit.states],
                hold=self.circuit.hold,
                outputs=[output.name for output in self.circuit.outputs],
            )


def circuit_structure(circuit: Circuit, segments: Sequence[Segment]) -> CircuitStructure:
    """What is searched: from equilibrium where the ambient is estimated, from any state where nodes are predicted."""
    return CircuitStructure(circuit, segments, [output.column for output in circuit.outputs] != [REFERENCE])
