"""The diagnosis without known-good records: what a circuit lacks, by the grey-box models that describe the data better.

Known-good records ask another question, what has changed on a device: ``diagnose.py`` answers it with the circuit held.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.stats import norm, wilcoxon

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.addition import with_values
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.file import extended_circuit, greybox_of
from ambient_trainer.diagnosis.greybox.model import Mechanism
from ambient_trainer.diagnosis.greybox.regression import FOLDS, Fitted, simulate
from ambient_trainer.diagnosis.greybox.stepwise import Progress, Selection, Trial, bare_fit, penalised, stepwise
from ambient_trainer.diagnosis.greybox.stepwise import Step as Chosen
from ambient_trainer.diagnosis.misfit import misfit_of
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record, diagnosis_period_s
from ambient_trainer.diagnosis.result import UNKNOWN, Cause, Diagnosis, Gain, Magnitude, Ranked, Step
from ambient_trainer.diagnosis.training import records_of
from ambient_trainer.diagnosis.view import View
from ambient_trainer.diagnosis.words import digits, window
from ambient_trainer.evaluation.black_box import black_box_rmse_degC

_ALIKE = 0.04
"""Of the penalised logarithm of held-out errors: rivals that are closer are not distinguishable."""
_MUCH, _EXPLAINABLE = 0.1, 0.35
"""A misfit is significant where it is so much of a sensor's deviation, and a black box with the same inputs explains so
much of it."""
_SMALL_DEGC, _UNDESCRIBED = 0.3, 0.5
_EVIDENT, _RESAMPLED = 0.95, 400
_SHORTEST = 5
"""Samples; a shorter stretch between gaps says where it began, and little else."""
_PER_TIME_CONSTANT, MOST_FINE = 0.34, 5000
"""Samples are a third of the fastest time constant apart, as far as so many of them allow."""
_EVERYWHERE = ("ambient_coupling", "convection_law")
"""Without a location they are those of all nodes."""
_CENTRE, _SLOPE = 0.1, 8.0
"""Of the margin over the closest other cause, in the logarithm of the held-out error."""


def diagnose_lacking(
    circuit: Circuit, traces: Sequence[Trace], period_s: float | None, progress: Progress | None
) -> Diagnosis:
    """What ``circuit`` lacks to describe ``traces``; see :func:`ambient_trainer.diagnosis.diagnose`."""
    plain = forward(circuit)
    period_s = period_s or fitting_period_s(plain, traces)
    every = [each for trace in traces for each in records_of(plain, trace, period_s)]
    own = [each for each in every if each.samples >= _SHORTEST] or every
    floor = _floor_degC(own)
    selection = stepwise(greybox_of(plain), own, floor, progress)
    longest = max(range(len(own)), key=lambda index: own[index].samples)
    steps = tuple(_steps(selection, longest))
    nothing = not steps and _misfits(selection, floor)
    if nothing or _undescribed(selection.final) or _confounded(selection):
        steps = (_unknown(selection.bare, longest),)
    fitted = with_values(plain, {each.name: each.value for each in selection.bare.model.own})
    seen = _seen(selection.bare, fitted, longest)
    named = bool(steps) and steps[0].cause.name != UNKNOWN
    extension = extended_circuit(circuit, selection.final.model) if named else None
    before, after = selection.bare.held_out_rmse_degC, selection.final.held_out_rmse_degC
    return Diagnosis(
        trace=", ".join(trace.path for trace in traces),
        circuit=circuit.name,
        baselines=(),
        time_s=own[longest].time_s,
        signals={**seen.signals, REFERENCE: seen.ambient_degC},
        misfit=misfit_of(seen),
        steps=steps,
        verdict=steps[0] if steps else None,
        ranking=tuple(_ranked(selection.steps[0], trial) for trial in selection.steps[0].trials),
        next_experiment=_next_experiment(steps),
        extended=extension,
        candidates_tried=selection.steps[0].tried,
        fitted=fitted,
        floor_degC=floor,
        explained_share=_share(before, after, floor),
    )


def _seen(bare: Fitted, fitted: Circuit, longest: int) -> View:
    """The longest record beside the simulation of the fitted circuit."""
    record, run = bare.records[longest], bare.runs[longest]
    linear = replace(fitted, mechanisms=())
    plant = Plant.of(linear, {each.name: each.initial for each in linear.parameters}, record.period_s)
    read = simulate(bare.model, record, bare.model.z()[None], run.start[None])[0]
    return replace(View.bare(plant, record), truth_degC=read, error_degC=np.zeros_like(read))


def fitting_period_s(plain: Circuit, traces: Sequence[Trace]) -> float:
    """A grid of at most 2000 samples, or a finer one where the circuit's fastest time constant asks for it."""
    coarse = diagnosis_period_s(traces)
    own = max(sampling_period_s(trace.time_s) for trace in traces)
    if coarse <= own:
        return coarse
    model = greybox_of(plain)
    fitted = bare_fit(model, [each for trace in traces for each in records_of(plain, trace, coarse)])
    # a fit without its cause may end at absurd time constants: the slower of the given and the fitted ones counts
    network = fitted.model.network(fitted.records[0], np.array([model.z(), fitted.model.z()]))
    rate = (network.between.sum(axis=2) + network.to_boundary.sum(axis=2)) / network.capacitance
    logged_s = max(sum(each.samples for each in fitted.records) * coarse, 1.0)
    wanted = max(_PER_TIME_CONSTANT / float(rate[:, network.reads].max(axis=1).min()), logged_s / MOST_FINE)
    return float(own * max(1.0, np.floor(min(coarse, wanted) / own + 1e-9)))


def _share(before: float, after: float, floor: float) -> float | None:
    """How much of what can be explained is explained; None where nothing can."""
    return min((before - after) / (before - floor), 1.0) if before - floor > 0.05 * before else None


def _floor_degC(own: Sequence[Record]) -> float:
    """What a black box with the same inputs leaves on folds of the longest record."""
    record = max(own, key=lambda each: each.samples)
    edges = np.linspace(0, record.samples, FOLDS + 1).astype(int)
    # the first fold is held out of no fit: how a run begins is seen nowhere else
    blocks = [slice(first, last) for first, last in pairwise(edges)][1:]
    inputs = {name: row for name, row in record.signals.items() if np.ptp(row) > 0}
    if not inputs:
        return float(np.sqrt(np.nanmean((record.sensors - np.nanmean(record.sensors, axis=1)[:, None]) ** 2)))
    return black_box_rmse_degC(record.time_s, inputs, record.sensors, blocks)


def _misfits(selection: Selection, floor_degC: float) -> bool:
    """Whether what the circuit leaves is large, beside what its sensors do and what could be explained."""
    bare = selection.bare
    if _undescribed(bare):
        return True
    deviation = np.sqrt(np.nanmean([np.nanvar(record.sensors) for record in bare.records]))
    large = bare.held_out_rmse_degC > max(_MUCH * deviation, _SMALL_DEGC)
    return bool(large and floor_degC < (1.0 - _EXPLAINABLE) * bare.held_out_rmse_degC)


def _undescribed(fitted: Fitted) -> bool:
    """Whether a sensor is left with more than half of its own deviation: the model does not describe the data."""
    read = np.concatenate([record.sensors for record in fitted.records], axis=1)
    left = np.concatenate([fitted.residual_degC(index) for index in range(len(fitted.records))], axis=1)
    share = np.nanmean(left**2, axis=1) / np.maximum(np.nanvar(read, axis=1), _SMALL_DEGC**2)
    return bool(share.max() > _UNDESCRIBED**2)


def _confounded(selection: Selection) -> bool:
    """Whether heat that nothing logged drives comes first, beside a reference that never moves: a warmer ambient and
    such heat are the same term."""
    given = len(selection.bare.model.mechanisms)
    first = selection.final.model.mechanisms[given : given + 1]
    constant = all(np.ptp(record.signals.get(REFERENCE, np.zeros(1))) == 0 for record in selection.final.records)
    return constant and any(each.cause == "heat_source" and each.driver is None for each in first)


def _steps(selection: Selection, longest: int) -> list[Step]:
    """The final model's mechanisms with the steps that added them; numbers are those of the final model."""
    final = selection.final
    result = []
    adding = [each for each in selection.steps if each.chosen is not None]
    given = len(selection.bare.model.mechanisms)
    for index, mechanism in list(enumerate(final.model.mechanisms))[given:]:
        step = next(each for each in adding if each.chosen is not None and each.chosen.mechanism.key == mechanism.key)
        adding = [each for each in adding if each is not step]
        chosen = step.chosen
        assert chosen is not None
        gain = _gain(step, chosen)
        magnitude, parameters = _numbers(final, index)
        rivals = [each for each in step.trials if _rival(each, chosen)]
        name = cause_of(mechanism, final.model.circuit)
        sentence = (
            f"{name}: {magnitude.meaning} {digits(magnitude.value)} {magnitude.unit} ({digits(magnitude.ci95[0])} to"
            f" {digits(magnitude.ci95[1])}), {''.join(f'{each}, ' for each in [magnitude.qualifier] if each)}"
            f"{window(mechanism.onset_s, mechanism.end_s)}; on held-out data"
            f" {gain.rmse_before_degC:.2f} becomes {gain.rmse_after_degC:.2f} degC."
        )
        result.append(
            Step(
                cause=cause_of(mechanism, final.model.circuit),
                onset_s=mechanism.onset_s,
                end_s=mechanism.end_s,
                magnitude=magnitude,
                confidence=_confidence(step, chosen, gain),
                gain=gain,
                indistinguishable_from=tuple(
                    dict.fromkeys(cause_of(each.mechanism, final.model.circuit) for each in rivals)
                ),
                sentence=sentence,
                parameters=parameters,
                residual_degC=chosen.fitted.residual_degC(longest),
            )
        )
    return result


def cause_of(mechanism: Mechanism, circuit: Circuit) -> Cause:
    """Its name, place and driver, as a diagnosis gives them."""
    places = mechanism.places
    location: str | tuple[str, ...] | None = places[0] if len(places) == 1 else places or None
    joined = {each for each, _ in circuit.to_ambient(circuit.states)}
    if len(places) > 1 and mechanism.cause in _EVERYWHERE and joined == set(places):
        location = None
    return Cause(mechanism.cause, location, None if mechanism.driver is None else mechanism.driver.text)


def _numbers(final: Fitted, index: int) -> tuple[Magnitude, dict[str, tuple[float, str]]]:
    mechanism = final.model.mechanisms[index]
    first = len(final.model.own) + sum(len(each.numbers) for each in final.model.mechanisms[:index])
    parameters = {}
    intervals = []
    for offset, number in enumerate(mechanism.numbers):
        error = 1.96 * math.sqrt(max(final.covariance[first + offset, first + offset], 0.0))
        low, high = (float(number.natural(np.float64(number.z + sign * error))) for sign in (-1.0, 1.0))
        parameters[number.name] = (number.value, number.unit)
        intervals.append((low, high))
    largest = max(
        range(len(intervals)), key=lambda each: abs(mechanism.numbers[each].z) * (not mechanism.numbers[each].log)
    )
    main = mechanism.numbers[largest]
    magnitude = Magnitude(main.value, main.unit, mechanism.meaning(main), intervals[largest], mechanism.sentence_tail())
    return magnitude, {**parameters, **mechanism.further()}


def _gain(step: Chosen, trial: Trial) -> Gain:
    """The held-out errors, with the interval of their difference by resampling blocks of time."""
    before, after = _blocks(step.before), _blocks(trial.fitted)
    error = step.before.held_out_rmse_degC, trial.fitted.held_out_rmse_degC
    gain = error[0] - error[1]
    p_value = 1.0
    if np.any(before != after):
        p_value = min(1.0, float(wilcoxon(before, after, alternative="greater").pvalue) * max(step.tried, 1))
    drawn = np.random.default_rng(0).integers(len(before), size=(_RESAMPLED, len(before)))
    gains = np.sqrt(before[drawn].mean(axis=1)) - np.sqrt(after[drawn].mean(axis=1))
    middle = float(np.sqrt(before.mean()) - np.sqrt(after.mean()))
    low, high = (gain + float(each) - middle for each in np.quantile(gains, [0.025, 0.975]))
    return Gain(*error, (low, high), p_value)


def _blocks(fitted: Fitted) -> Array:
    """The mean square of each block of time."""
    residual, block = fitted.residual, fitted.block
    return np.array([np.mean(residual[block == each] ** 2) for each in np.unique(block)])


def _rival(trial: Trial, chosen: Trial) -> bool:
    if chosen.mechanism.evident:
        return False
    other = trial.mechanism.key != chosen.mechanism.key and trial.mechanism.cause != chosen.mechanism.cause
    kind = (trial.mechanism.instrument, trial.mechanism.responds)
    same = kind == (chosen.mechanism.instrument, chosen.mechanism.responds)
    return other and same and not trial.fitted.at_bounds and penalised(trial) - penalised(chosen) < _ALIKE


def _confidence(step: Chosen, chosen: Trial, gain: Gain) -> float:
    """The probability that the cause, its place and its driver are right, by the margin over the closest other."""
    if chosen.mechanism.evident:
        return _EVIDENT
    others = [each for each in step.trials if each.mechanism.key != chosen.mechanism.key and not each.fitted.at_bounds]
    margin = min((penalised(each) - penalised(chosen) for each in others), default=1.0)
    total = math.log(gain.rmse_before_degC / gain.rmse_after_degC)
    sure = float(norm.cdf(2.0 * total / 0.35 - 0.5))
    return min(0.98, sure / (1.0 + math.exp(-_SLOPE * (min(margin, total) - _CENTRE))))


def _ranked(step: Chosen, trial: Trial) -> Ranked:
    mechanism = trial.mechanism
    magnitude, _ = _numbers(trial.fitted, len(trial.fitted.model.mechanisms) - 1)
    gain = _gain(step, trial)
    if step.chosen is trial:
        remark = "taken"
    elif trial.fitted.at_bounds:
        remark = "a number ends at a physical bound"
    elif step.chosen is not None and _rival(trial, step.chosen):
        remark = "not distinguishable from the one taken"
    elif gain.rmse_after_degC > gain.rmse_before_degC * 0.95:
        remark = "no sure gain on held-out data"
    elif mechanism.responds:
        remark = "a temperature that may answer to the same cause"
    elif mechanism.instrument:
        remark = "an instrument, where physics does about as well"
    else:
        remark = "gains less on held-out data" if step.chosen else "gains too little to matter"
    return Ranked(
        cause_of(mechanism, trial.fitted.model.circuit), mechanism.onset_s, mechanism.end_s, magnitude, gain, remark
    )


def _unknown(bare: Fitted, longest: int) -> Step:
    error = bare.held_out_rmse_degC
    gain = Gain(error, error, (0.0, 0.0), 1.0)
    sentence = f"The simulation is {error:.2f} degC off."
    return Step(Cause(UNKNOWN), None, None, None, 0.0, gain, (), sentence, {}, bare.residual_degC(longest))


def _next_experiment(steps: Sequence[Step]) -> str:
    for step in steps:
        for rival in step.indistinguishable_from:
            mine, other = step.cause.signal or AMBIENT, rival.signal or AMBIENT
            if mine != other:
                return f"To distinguish {step.cause} from {rival}, log {mine} while it changes and {other} does not."
            return f"To distinguish {step.cause} from {rival}, log twice as long, with larger changes of {mine}."
    if steps and steps[0].cause.name == UNKNOWN:
        return "Log more of what goes on at the device, above all what changes together with the heat shown below."
    return ""
