"""A diagnosis: the misfit is shown, its causes are found one after the other, and what each gains is measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from ambient_model.faults import Fault, Refused
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.causes import kind_of
from ambient_trainer.diagnosis.experiment import next_experiment
from ambient_trainer.diagnosis.extended_circuit import Extension, extended_circuit
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.gain import Blocks, differ
from ambient_trainer.diagnosis.misfit import misfit_of
from ambient_trainer.diagnosis.model import Effect
from ambient_trainer.diagnosis.record import Record, diagnosis_period_s
from ambient_trainer.diagnosis.result import UNKNOWN, Cause, Diagnosis, Gain, Ranked, Step
from ambient_trainer.diagnosis.selection import Selection, SelectionStep, Trial, known_good_model, select_effects
from ambient_trainer.diagnosis.training import TrainedCircuit, records_of, train_on_baselines, train_on_diagnosed
from ambient_trainer.diagnosis.view import conductances_to_ambient
from ambient_trainer.diagnosis.words import digits, window

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

FEWEST_SAMPLES = 100
_MOST_UNEXPLAINED = 0.5
"""Of a sensor's own spread: a simulation that leaves more has not understood the data, whatever was added to it."""
_MOST_MISFIT, _MOST_OF_A_LARGE_MISFIT = 2.0, 8.0
"""In units of what known-good records leave: below the one the data are understood, beyond the other they are not."""
_ROUNDING_DEGC = 0.051
"""Two instruments differ by more at some time; a column and its copy with one decimal do not."""


def diagnose(
    circuit: Circuit,
    traces: Sequence[Trace],
    baselines: Sequence[Trace] = (),
    progress: Progress | None = None,
    period_s: float | None = None,
) -> Diagnosis:
    """What ``traces`` hold that ``circuit`` does not describe: what changed since ``baselines``, or what it lacks.

    Raises :class:`Refused` where the traces cannot tell: too short, without a column, nothing that moves.
    """
    plain = forward(circuit)
    _fit_to_diagnose(plain, [*traces, *baselines])
    period_s = period_s or diagnosis_period_s([*traces, *baselines])
    with threadpool_limits(1):
        if baselines:
            trained = train_on_baselines(plain, baselines, period_s, known_good_model, _training(progress))
        else:
            trained = train_on_diagnosed(plain, traces, period_s, _training(progress))
        return diagnose_trained(trained, circuit, traces, [trace.path for trace in baselines], period_s, progress)


def diagnose_trained(
    trained: TrainedCircuit,
    circuit: Circuit,
    traces: Sequence[Trace],
    baselines: Sequence[str],
    period_s: float,
    progress: Progress | None = None,
) -> Diagnosis:
    """:func:`diagnose` with a circuit that was trained before, as when many traces are put to the same question."""
    own = [each for trace in traces for each in records_of(trained.model.plant.circuit, trace, period_s)]
    chosen = select_effects(trained, own, progress)
    steps = _steps(chosen, own)
    if not _describes(chosen, trained, own):
        steps = (_unknown(chosen),)
    named = bool(steps) and steps[0].cause.name != UNKNOWN
    extension = extended_circuit(circuit, chosen.final.model) if named else Extension(None, ())
    view = chosen.plain.longest
    return Diagnosis(
        trace=", ".join(trace.path for trace in traces),
        circuit=circuit.name,
        baselines=tuple(baselines),
        time_s=view.record.time_s,
        signals={**view.signals, REFERENCE: view.ambient_degC},
        misfit=misfit_of(view),
        steps=steps,
        verdict=steps[0] if steps else None,
        ranking=_ranking(chosen.choices[0]),
        next_experiment=next_experiment(chosen, steps),
        extended=extension.circuit,
        candidates_tried=chosen.choices[0].tried,
        notes=extension.left_out,
    )


def _training(progress: Progress | None) -> Callable[[int, int, float], None] | None:
    if progress is None:
        return None
    return lambda done, total, rmse: progress("fit", done, total)


def _fit_to_diagnose(circuit: Circuit, traces: Sequence[Trace]) -> None:
    faults = []
    for trace in traces:
        if len(trace.time_s) < FEWEST_SAMPLES:
            mend = f"log at least {FEWEST_SAMPLES}"
            faults.append(Fault(trace.path, f"{len(trace.time_s)} samples tell nothing of a cause", mend))
        faults.extend(_empty(circuit, trace))
        for name in circuit.inputs:
            faults.extend(_same_as_a_sensor(circuit, trace, name))
    if faults:
        raise Refused("diagnose", faults)


def _empty(circuit: Circuit, trace: Trace) -> list[Fault]:
    wanted = (*circuit.inputs, *(output.column for output in circuit.outputs))
    return [
        Fault(trace.path, f"{name} holds no value at all", "log it, or take a circuit without it")
        for name in wanted
        if np.isnan(trace.column(name)).all()
    ]


def _same_as_a_sensor(circuit: Circuit, trace: Trace, name: str) -> list[Fault]:
    if not name.endswith("_degC"):
        return []
    return [
        Fault(trace.path, f"{name} is {output.column}, value by value", "log what it stands for")
        for output in circuit.outputs
        if _alike(trace.column(output.column), trace.column(name))
    ]


def _alike(one: Array, other: Array) -> bool:
    apart = np.abs(one - other)
    return bool((apart[~np.isnan(apart)] <= _ROUNDING_DEGC).all()) and not np.isnan(apart).all()


def _steps(chosen: Selection, own: Sequence[Record]) -> tuple[Step, ...]:
    taken = [(choice, choice.taken) for choice in chosen.choices if choice.taken is not None]
    final = [effect for effect in chosen.final.model.effects if not effect.known]
    return tuple(
        _step(choice, trial, effect, chosen, number)
        for number, ((choice, trial), effect) in enumerate(zip(taken, final))
    )


def _step(choice: SelectionStep, trial: Trial, effect: Effect, chosen: Selection, number: int) -> Step:
    view = chosen.final.longest
    found = effect.found(view)
    magnitude = effect.candidate.magnitude(found)
    rivals = tuple(dict.fromkeys(rival.cause for rival in choice.rivals))
    gain = trial.gain
    parameters = effect.candidate.parameters(found)
    sentence = (
        f"{effect.candidate.cause}: {magnitude.meaning} {digits(magnitude.value)} {magnitude.unit}"
        f" ({digits(magnitude.ci95[0])} to {digits(magnitude.ci95[1])}), {window(effect.onset_s, effect.end_s)};"
        f" on held-out data {gain.rmse_before_degC:.2f} becomes {gain.rmse_after_degC:.2f} degC."
    )
    return Step(
        cause=effect.candidate.cause,
        onset_s=effect.onset_s,
        end_s=effect.end_s,
        magnitude=magnitude,
        confidence=_confidence(choice, trial),
        gain=gain,
        indistinguishable_from=rivals,
        sentence=sentence,
        parameters=parameters,
        residual_degC=max(chosen.views[number], key=lambda each: each.record.samples).residual_degC,
    )


def _confidence(choice: SelectionStep, taken: Trial) -> float:
    """That neither chance nor the closest other cause does as well, by the blocks' held-out errors."""
    others = [each for each in choice.trials if each.cause != taken.cause]
    ahead = min((differ(each.blocks, taken.blocks) for each in others), default=np.inf)
    return float(norm.cdf(ahead) * (1.0 - taken.gain.p_value))


def _ranking(choice: SelectionStep) -> tuple[Ranked, ...]:
    rivals = {id(each) for each in choice.rivals}
    return tuple(
        Ranked(
            each.cause,
            each.effect.onset_s,
            each.effect.end_s,
            each.effect.magnitude(each.fitted.longest),
            each.gain,
            _remark(choice, each, id(each) in rivals),
        )
        for each in choice.trials
    )


def _remark(choice: SelectionStep, trial: Trial, rival: bool) -> str:
    if trial is choice.taken:
        return "taken"
    if trial.gain.ci95_degC[0] <= 0:
        return "no sure gain on held-out data"
    if choice.taken is None:
        return "gains too little to matter"
    if rival:
        return "the data cannot tell it from the one taken"
    if trial.blocks.white.sum() < choice.taken.blocks.white.sum():
        return "gains a little more, with more unknowns"
    return "gains less on held-out data"


def _describes(chosen: Selection, trained: TrainedCircuit, own: Sequence[Record]) -> bool:
    """Whether the model with all its steps describes the data, or most of the misfit: else no cause is to be named."""
    left = np.concatenate([each.residual_degC for each in chosen.final.views], axis=1)
    read = np.concatenate([record.sensors for record in own], axis=1)
    spread = np.nanvar(read, axis=1)
    square = np.nanmean(left**2, axis=1)
    # all together, and the one that is worst off: a reading of noise drowns among others that are understood
    for unexplained, whole in ((square.mean(), spread.mean()), (square.max(), spread[square.argmax()])):
        if unexplained > _MOST_UNEXPLAINED**2 * max(whole, 1e-12):
            return False
    if _confounded_with_ambient(chosen):
        return False
    if not trained.normal:
        return True
    before, after = (Blocks.of(each, trained.noise).relative(trained.noise) for each in (chosen.plain, chosen.final))
    return after < max(_MOST_MISFIT, min(_MOST_UNEXPLAINED * before, _MOST_OF_A_LARGE_MISFIT))


def _confounded_with_ambient(chosen: Selection) -> bool:
    """Whether the first step is heat that would be none if the ambient had moved, of which the reference tells nothing.

    Heat into a node and a warmer ambient of it are one and the same to its equation.
    """
    cause = next((each.taken.cause for each in chosen.choices if each.taken is not None), None)
    if cause is None or cause.signal is not None or not kind_of(cause).heats:
        return False
    plant = chosen.final.model.plant
    joined = [name for name, each in zip(plant.nodes, conductances_to_ambient(plant)) if each > 0]
    return cause.location in joined and all(np.ptp(view.ambient_degC) == 0 for view in chosen.plain.views)


def _unknown(chosen: Selection) -> Step:
    before = Blocks.of(chosen.plain, chosen.noise).rmse_degC()
    sentence = f"The simulation is {before:.2f} degC off."
    gain = Gain(before, before, (0.0, 0.0), 1.0)
    return Step(Cause(UNKNOWN), None, None, None, 0.0, gain, (), sentence, {}, chosen.plain.longest.residual_degC)
