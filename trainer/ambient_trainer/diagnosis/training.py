"""The circuit before any step of a diagnosis: its parameters with their prior, and the noise that it leaves.

Known-good records of the same device fit the circuit, which is then held: the question is what changed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.fit import TrainingSet, fit_model, information
from ambient_trainer.diagnosis.model import Model, view
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.prior import Prior
from ambient_trainer.diagnosis.record import Record, means, records, straight
from ambient_trainer.diagnosis.setting import heat_in_watts
from ambient_trainer.estimation.noise import Noise
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.circuit import CircuitEstimator


@dataclass(frozen=True)
class TrainedCircuit:
    """A forward circuit with values and what else good records need, those that trained it, and the noise they leave.

    ``searched`` names the circuit's free parameters, ``prior`` says what is known of them; ``normal`` is empty where
    there are no known-good records.
    """

    model: Model
    noise: Noise
    normal: tuple[Record, ...]
    searched: tuple[str, ...]
    prior: Prior

    def training(self, own: Sequence[Record], noise: Noise) -> TrainingSet:
        """What a model of the diagnosed records is fitted to."""
        return TrainingSet(tuple(own), noise, self.searched, self.prior)


def train_on_baselines(
    circuit: Circuit,
    baselines: Sequence[Trace],
    period_s: float,
    known_good_model: Callable[[TrainedCircuit, Sequence[Record]], Model],
    progress: Progress | None,
) -> TrainedCircuit:
    """``circuit`` (forward) fitted to known-good traces, with the effects that ``known_good_model`` adds."""
    plant = _fitted(circuit, baselines, period_s, progress)
    normal = tuple(each for trace in baselines for each in records_of(plant.circuit, trace, period_s))
    model = known_good_model(_by_design(Model(plant), normal, searched(circuit)), normal)
    noise = residual_noise(model, normal)
    names = searched(circuit)
    known = information(model, TrainingSet(normal, noise, names, Prior.by_design(model, names)))
    return TrainedCircuit(model, noise, normal, names, Prior.trained(model, names, known))


def _by_design(model: Model, own: Sequence[Record], names: tuple[str, ...]) -> TrainedCircuit:
    """Parameters that the records do not determine go back towards the values of the circuit's file."""
    noise = residual_noise(model, own)
    prior = Prior.by_design(model, names)
    model = fit_model(model, TrainingSet(tuple(own), noise, names, prior), _ROUNDS).model
    return TrainedCircuit(model, residual_noise(model, own), (), names, prior)


def records_of(circuit: Circuit, trace: Trace, period_s: float) -> list[Record]:
    """The records of a trace, with the circuit's inputs and sensors."""
    return records(trace, circuit.inputs, _read(circuit), period_s, circuit.hold)


def _read(circuit: Circuit) -> list[str]:
    return [output.column for output in circuit.outputs]


def residual_noise(model: Model, own: Sequence[Record]) -> Noise:
    """The noise of a model on these records."""
    return Noise.of([view(model, record).residual_degC for record in own])


def _fitted(circuit: Circuit, traces: Sequence[Trace], period_s: float, progress: Progress | None) -> Plant:
    shown = [means(straight(trace, _read(circuit), circuit.hold), period_s) for trace in traces]
    fit = CircuitEstimator(replace(circuit, hold="first-order")).fit(shown, Effort(starts=_STARTS), progress, period_s)
    values = {each.name: each.initial for each in circuit.parameters}
    values.update({each.name: each.value for each in fit.parameters})
    return Plant.of(circuit, values, period_s)


_STARTS, _ROUNDS = 3, 8


def searched(circuit: Circuit) -> tuple[str, ...]:
    """The free resistances, capacitances and shares of sources.

    Where no power sets the scale of heat, one capacitance stays as it is: all else is relative to it.
    """
    used = {each.capacitance for each in circuit.nodes} | {each.resistance for each in circuit.edges}
    used |= {source.share for source in circuit.sources}
    names = [each.name for each in circuit.parameters if each.free and each.name in used]
    if not heat_in_watts(circuit):
        names.remove(next(str(node.capacitance) for node in circuit.states if node.capacitance in names))
    return tuple(names)
