"""What is known before the question is put: the circuit's parameters, and what noise a good simulation leaves.

With known-good records of the same device the circuit is taught by them and then held: the question is what changed.
Without, it is fitted to the diagnosed records themselves and stays free: the question is what it lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.extended import Model, view
from ambient_trainer.diagnosis.noise import Noise
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record, means, records
from ambient_trainer.identify.fit import Effort, fit_circuit
from ambient_trainer.identify.search import Progress
from ambient_trainer.traces.trace import Trace


@dataclass(frozen=True)
class Taught:
    """A forward circuit with values and what else good records need, those that taught it, and the noise they leave.

    ``normal`` is empty, and ``searched`` names the circuit's free parameters, where there are no known-good records.
    """

    model: Model
    noise: Noise
    normal: tuple[Record, ...]
    searched: tuple[str, ...]


def taught_by_baselines(
    circuit: Circuit,
    baselines: Sequence[Trace],
    period_s: float,
    lacking: Callable[[Taught, Sequence[Record]], Model],
    progress: Progress | None,
) -> Taught:
    """``circuit`` (forward) as known-good traces show it, with what ``lacking`` finds that it needs besides."""
    plant = _fitted(circuit, baselines, period_s, progress)
    normal = tuple(each for trace in baselines for each in records_of(plant.circuit, trace, period_s))
    plain = Taught(Model(plant), left_over(Model(plant), normal), (), searched(circuit))
    model = lacking(plain, normal)
    return Taught(model, left_over(model, normal), normal, ())


def taught_by_itself(circuit: Circuit, traces: Sequence[Trace], period_s: float, progress: Progress | None) -> Taught:
    """``circuit`` (forward) as well as it can be made to fit the diagnosed traces."""
    plant = _fitted(circuit, traces, period_s, progress)
    own = [each for trace in traces for each in records_of(plant.circuit, trace, period_s)]
    return Taught(Model(plant), left_over(Model(plant), own), (), searched(circuit))


def records_of(circuit: Circuit, trace: Trace, period_s: float) -> list[Record]:
    """The records of a trace, with the circuit's inputs and sensors."""
    return records(trace, circuit.inputs, [output.column for output in circuit.outputs], period_s)


def left_over(model: Model, own: Sequence[Record]) -> Noise:
    """The noise of a model on these records."""
    return Noise.of([view(model, record).residual_degC for record in own])


def _fitted(circuit: Circuit, traces: Sequence[Trace], period_s: float, progress: Progress | None) -> Plant:
    fit = fit_circuit(circuit, [means(trace, period_s) for trace in traces], Effort(starts=_STARTS), progress, period_s)
    if fit.stopped:
        # a search keeps its best when it is interrupted; whoever waits for a diagnosis wanted it to end
        raise KeyboardInterrupt
    values = {each.name: each.initial for each in circuit.parameters}
    values.update({each.name: each.value for each in fit.parameters})
    return Plant.of(circuit, values, period_s)


_STARTS = 3


def searched(circuit: Circuit) -> tuple[str, ...]:
    """The free resistances, capacitances and shares of sources."""
    used = {each.capacitance for each in circuit.nodes} | {each.resistance for each in circuit.edges}
    used |= {source.share for source in circuit.sources}
    return tuple(each.name for each in circuit.parameters if each.free and each.name in used)
