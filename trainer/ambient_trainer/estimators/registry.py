"""Lookup of estimators by name: the modules in ``library`` first; any other name is a circuit.

An entry point in the group ``ambient_trainer.estimators.library`` counts like a module there.
"""

from collections.abc import Sequence

from ambient_model.faults import refuse
from ambient_trainer.circuits import Circuit, load_circuit
from ambient_trainer.data import Trace
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.estimation import CircuitStructure, Progress, search
from ambient_trainer.estimators.base import Effort, Estimator, Fit, Training, require_enough, training_segments
from ambient_trainer.estimators.searched import fit_of


class CircuitEstimator(Estimator):
    """Fits a circuit, each stretch from thermal equilibrium with its first sample; it names its trace columns."""

    reads_any = False
    starts_apart = True

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.name, self.own_columns = circuit.name, circuit.inputs

    def training(
        self, traces: Sequence[Trace], inputs: Sequence[str] | None, period_s: float | None, pieces: int
    ) -> Training:
        """The grids over the circuit's own columns, by default at each trace's own period."""
        outputs = [output.column for output in self.circuit.outputs]
        columns = self.circuit.inputs
        return Training(columns, training_segments(traces, columns, outputs, period_s, pieces), traces)

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to this training data."""
        structure, circuit = CircuitStructure(self.circuit, training.segments), self.circuit
        require_enough(training.traces, structure)
        result = search(structure, effort.starts, effort.seed, progress, effort.budget, effort.first)
        theta, beta = result.best.theta, result.best.beta
        values, logarithmic = structure.values(theta, beta), structure.logarithmic_names
        # what the file gives as a bare number has a place for a name, with dots in it
        shown = [each for each in circuit.parameters if each.free or "." not in each.name]
        unknowns = [(each.name, each.unit, values[each.name], each.name in logarithmic) for each in shown]
        system, states = structure.system(theta, beta), [node.name for node in circuit.states]
        about = circuit.name, circuit.inputs, states, circuit.hold, [output.name for output in circuit.outputs]
        return fit_of(structure, result, effort, system, unknowns, *about)


LIBRARY = "ambient_trainer.estimators.library"


def estimator_names() -> tuple[str, ...]:
    """The names of all estimators but the circuits'."""
    return tuple(name for each in plugin_names(LIBRARY) for name in plugin(LIBRARY, each).NAMES)


def estimator(name: str, sensors: Sequence[str] = ()) -> Estimator:
    """The estimator called ``name``, or of the circuit or recipe in that YAML file.

    ``sensors`` are the trace columns that it shall read. Raises :class:`Refused` for an unknown name, a file with
    faults, and sensors of an estimator that names its own.
    """
    found = _find(name) or CircuitEstimator(load_circuit(name, estimator_names()))
    if sensors and not found.reads_any:
        reading_any = [each for each in estimator_names() if getattr(_find(each), "reads_any", False)]
        raise refuse("sensors", "", f"{found.name} names its own", f"use it with {', '.join(reading_any)}")
    return found


def thermal_circuit(name: str) -> Circuit:
    """The circuit called ``name``, whose nodes and parameters have a meaning; estimators without one are refused."""
    if _find(name) is not None:
        raise refuse("circuit", "", f"{name} has no parameters with a meaning", "name a thermal circuit")
    return load_circuit(name)


def _find(name: str) -> Estimator | None:
    found = (plugin(LIBRARY, each).find(name) for each in plugin_names(LIBRARY))
    return next((each for each in found if each is not None), None)
