"""Diagnosis by stepwise model extension: fit the circuit, add what it lacks step by step, measure each step's gain.

Without known-good records the question is what the circuit lacks, with them what has changed since.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from ambient_model.faults import Fault, Refused
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.addition import with_values
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.diagnosis.findings import (
    ambient_is_constant,
    ranking_of,
    residuals_degC,
    retained_mechanisms,
    steps_of,
    unknown_step,
)
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.backward import eliminate_backward, score, steps_to
from ambient_trainer.diagnosis.greybox.choice import ENDOGENOUS_PENALTY, Limits, is_significant
from ambient_trainer.diagnosis.greybox.file import extended_circuit, greybox_of
from ambient_trainer.diagnosis.greybox.model import Mechanism
from ambient_trainer.diagnosis.greybox.regression import FOLDS, Fitted
from ambient_trainer.diagnosis.greybox.screening import ambient_distinct_candidates, change_candidates
from ambient_trainer.diagnosis.greybox.stepwise import Progress, Selection, anchors, bare_fit, continued, stepwise
from ambient_trainer.diagnosis.known_good import KnownGood, train_on_baselines
from ambient_trainer.diagnosis.misfit import misfit_of
from ambient_trainer.diagnosis.next_experiment import next_experiment
from ambient_trainer.diagnosis.record import Record, diagnosis_period_s, finely_simulated
from ambient_trainer.diagnosis.result import UNKNOWN, Diagnosis, Step
from ambient_trainer.evaluation.black_box import black_box_rmse_degC

FEWEST_SAMPLES = 100
_ROUNDING_DEGC = 0.051
"""Maximum difference between a column and its copy rounded to one decimal."""
_MIN_MISFIT_SHARE, _MIN_EXPLAINABLE_SHARE = 0.1, 0.35
"""Minimum share of a misfit in a sensor's deviation, minimum share that a black box with the same inputs explains, or
maximum share of noise in it, for the misfit to be significant."""
_MIN_SD_DEGC, _MAX_WORST, _MIN_EXPLAINED = 0.3, 0.5, 0.5
_MAX_ANY, _MAX_OVERALL, _HALF = 0.9, 0.45, 0.5
_LEAST_DEGC = 0.05
"""Minimum gain of a step where a sensor's noise is unknown: a measured tank that only cools deviates by less."""
_MAX_WHITE_SHARE = 0.7
"""Maximum share of white noise in a residual: it is a half in a measured house, and one in noise."""
_MOST_MISFIT, _MOST_OF_A_LARGE_MISFIT = 2.0, 4.0
"""Ratios to the error on known-good records: below the first a change is explained, above the second it is not."""
_SLOW_FRAC = 1.0 / 3.0
"""Share of the record's length; a slower mass is a boundary of unknown temperature."""
_MAX_RISE_DEGC = 20.0
"""Maximum error of a logged room temperature."""
_NEAR_AMBIENT_FRAC, _MIN_RATIO_FROM_REST = 0.1, 0.85
"""Of the largest rise: how far from the ambient readings may begin, and what the least rise has to be then."""
_MIN_RATIO = 0.5
"""Minimum ratio of the smallest to the largest temperature rise where a warmer room may explain both."""
_MIN_JOINT_GAIN = 0.3
"""Minimum gain in penalised log error for causes found jointly to replace the steps."""
_SHORTEST = 5
"""Samples; a shorter stretch between gaps says where it began, and little else."""


def diagnose(
    circuit: Circuit,
    traces: Sequence[Trace],
    baselines: Sequence[Trace] = (),
    progress: Progress | None = None,
    period_s: float | None = None,
) -> Diagnosis:
    """Name what a circuit lacks to describe traces: see :func:`ambient_trainer.diagnose`.

    All candidates are screened by a score test (Rao 1948) on simulated states; the best are fitted together with the
    circuit's numbers. Without ``baselines`` a circuit is simulated in the log's own samples, or in fewer steps where
    these are more than 10,000; with them its numbers have a prior from these.
    """
    _check(circuit, [*traces, *baselines])
    period_s = period_s or diagnosis_period_s([*traces, *baselines])
    if not baselines:
        with threadpool_limits(1):
            return _find_missing(circuit, traces, period_s, progress)
    known = learn_known_good(circuit, baselines, progress, period_s)
    return diagnose_changed(known, circuit, traces, [trace.path for trace in baselines], progress)


def learn_known_good(
    circuit: Circuit, baselines: Sequence[Trace], progress: Progress | None = None, period_s: float | None = None
) -> KnownGood:
    """A circuit as known-good traces have it, for :func:`diagnose_changed`; raises :class:`Refused` as ``diagnose``."""
    _check(circuit, baselines)
    with threadpool_limits(1):
        return train_on_baselines(forward(circuit), baselines, period_s or diagnosis_period_s(baselines), progress)


def diagnose_changed(
    known: KnownGood,
    circuit: Circuit,
    traces: Sequence[Trace],
    baselines: Sequence[str],
    progress: Progress | None = None,
) -> Diagnosis:
    """:func:`diagnose` with a circuit that was trained before, for many traces of one device."""
    _check(circuit, traces)
    own = _long_enough(known.records(traces))
    with threadpool_limits(1):
        bare = known.bare_fit(own)
        selection = stepwise(bare, limits=Limits(known.rmse_degC), progress=progress, offered=change_candidates)
    before, final, good = selection.bare.held_out_rmse_degC, selection.final, known.rmse_degC
    most = max(_MOST_MISFIT, min(_MAX_WORST * before / good, _MOST_OF_A_LARGE_MISFIT))
    permanent = all(each.permanent for each in final.model.mechanisms)
    followed = not permanent and final.by_stretches_degC(selection.bare) < _MOST_MISFIT * good
    described = (followed or final.held_out_rmse_degC < most * good) and not _reads_a_sensor(bare)
    return _diagnosis(circuit, traces, selection, None, baselines, described=described)


def _reads_a_sensor(bare: Fitted) -> bool:
    """Whether the ambient equals one sensor's reading except for noise, although known-good records differ.

    Of a device that is off, all sensors are like that.
    """
    apart = np.concatenate([each.sensors - each.signals.get(REFERENCE, 0.0) for each in bare.records], axis=1)
    noise_degC, deviation_degC = np.sqrt(np.nanmean(np.diff(apart, axis=1) ** 2, axis=1) / 2), np.nanstd(apart, axis=1)
    white = noise_degC > _MAX_WHITE_SHARE * deviation_degC
    expected = np.sqrt(np.nanmean(residuals_degC(bare) ** 2, axis=1)) < _MOST_OF_A_LARGE_MISFIT * deviation_degC
    return bool((white & ~expected).any() and not white.all())


def _find_missing(circuit: Circuit, traces: Sequence[Trace], period_s: float, progress: Progress | None) -> Diagnosis:
    plain = forward(circuit)
    own = _long_enough([each for trace in traces for each in finely_simulated(plain, trace, period_s)])
    model, limits = greybox_of(plain), Limits(_floor_degC(own), _LEAST_DEGC)
    bare, beside = bare_fit(model, own), anchors(model, own)
    selection = stepwise(bare, beside, limits, progress)
    if _confounded(selection):
        selection = _resolve_confounding(selection, limits, progress)
    found = _diagnosis(circuit, traces, selection, limits.floor_degC, ())
    if progress is not None:
        progress("fit all effects at once", 0, 1)
    points = [bare, *beside] if _never_settles(bare) else [bare]
    together = min(filter(None, map(eliminate_backward, points)), key=score, default=None)
    if together is None or not _is_better_than_steps(selection, found, together):
        return found
    selection = continued(selection, together, beside, limits, progress)
    again = _diagnosis(circuit, traces, selection, limits.floor_degC, ())
    return found if again.verdict_cause.name == UNKNOWN else again


def _resolve_confounding(confounded: Selection, limits: Limits, progress: Progress | None) -> Selection:
    """Resolve a confounded selection: logged heat first, where it is needed; else select among candidates that a warmer
    ambient cannot replace, if a physical cause is found."""
    steps = steps_to(confounded.bare, confounded.final, confounded.compared.tried)
    held = [(each.chosen.mechanism, each) for each in steps if each.chosen is not None]
    # a delay of its own may follow whatever the ambient did
    if any(each.driver is not None and not each.tuned and step.gain > _MIN_JOINT_GAIN for each, step in held):
        held.sort(key=lambda each: each[0].driver is None)
        return replace(confounded, steps=tuple(step for _, step in held))
    found = stepwise(confounded.bare, (), limits, progress, ambient_distinct_candidates)
    first = found.steps[0]
    if first.chosen is None or first.chosen.mechanism.instrument:
        return confounded
    rivals = replace(first, trials=confounded.compared.trials)
    return replace(found, steps=(rivals, *found.steps[1:]), compared=confounded.compared)


def _is_better_than_steps(selection: Selection, found: Diagnosis, together: Fitted) -> bool:
    """Whether causes that were found together beat the steps, by more where another temperature, which may answer to
    the same cause, is among them; or the circuit by itself, where steps have led to no name: by as much, or in most
    folds and by half in sample."""
    bare = selection.bare
    if found.verdict_cause.name != UNKNOWN:
        answers = any(each.endogenous for each in together.model.mechanisms)
        return score(together) <= score(selection.final) - math.log(ENDOGENOUS_PENALTY) * answers - _MIN_JOINT_GAIN
    gains = score(together) < score(bare) and is_significant(bare.held_out - together.held_out)
    return score(together) <= score(bare) - _MIN_JOINT_GAIN or (gains and together.rmse_degC < _HALF * bare.rmse_degC)


def _never_settles(bare: Fitted) -> bool:
    """Whether a node ends with a time constant to the ambient longer than the record: under a thermostat readings stay
    where they are, and no heat shows itself beside such a one."""
    network = bare.model.network(bare.records[0], bare.model.z()[None])
    out = network.to_boundary[0].sum(axis=1) + network.between[0].sum(axis=1)
    longest_s = max(record.samples * record.period_s for record in bare.records)
    return bool((network.capacitance[0] > longest_s * out).any())


def _long_enough(records: list[Record]) -> list[Record]:
    return [each for each in records if each.samples >= _SHORTEST] or records


def _diagnosis(
    circuit: Circuit,
    traces: Sequence[Trace],
    selection: Selection,
    floor_degC: float | None,
    baselines: Sequence[str],
    described: bool = True,
) -> Diagnosis:
    bare, final = selection.bare, selection.final
    longest = max(range(len(bare.records)), key=lambda index: bare.records[index].samples)
    steps = steps_of(selection, longest)
    before, after = bare.held_out_rmse_degC, final.held_out_rmse_degC
    share = None if floor_degC is None else _share(before, after, floor_degC)
    nothing = not steps and floor_degC is not None and _has_large_misfit(bare, floor_degC)
    much_left = _much_left(final, share)
    white = _noise_degC(final) > _MAX_WHITE_SHARE * final.rmse_degC
    # an instrument's fault fits whatever physics leaves, and rows in any order have drivers, too, which gain little
    blamed = any(each.instrument for each in final.model.mechanisms[len(bare.model.mechanisms) :])
    unsure = much_left and (blamed or white)
    halved = after < _HALF * before and not blamed and _left(final)[0] < _MAX_ANY
    nameless = unsure and not (halved or _heat_halves_error(steps))
    if nothing or not described or nameless or _confounded(selection):
        steps, share = (unknown_step(bare, longest),), None
    elif much_left and share is not None:
        steps = tuple(replace(each, confidence=share * each.confidence) for each in steps)
    if bare.model.mechanisms:
        fitted = extended_circuit(circuit, bare.model)
    else:
        fitted = with_values(forward(circuit), {each.name: each.value for each in bare.model.own})
    record = bare.records[longest]
    own = bare.model.network(record, bare.model.z()[None])
    simulated = record.sensors - bare.residual_degC(longest)
    named = bool(steps) and steps[0].cause.name != UNKNOWN
    # a black box foretells no heat that nothing logged goes along with, so it may do no better
    more = much_left or (not white and _left(final)[1] > _MAX_OVERALL)
    return Diagnosis(
        trace=", ".join(trace.path for trace in traces),
        circuit=circuit.name,
        baselines=tuple(baselines),
        time_s=record.time_s,
        signals={name: row for name, row in record.signals.items() if name == REFERENCE or not name.endswith("_degC")},
        misfit=misfit_of(bare.model.circuit, own, record, simulated),
        steps=steps,
        verdict=steps[0] if steps else None,
        ranking=ranking_of(selection, named),
        next_experiment=next_experiment(selection, steps),
        extended=extended_circuit(circuit, final.model) if named else None,
        candidates_tried=selection.compared.tried,
        fitted=fitted,
        bare_degC=before,
        floor_degC=floor_degC,
        explained_share=share,
        notes=(f"{final.rmse_degC:.2f} degC is left: something else is missing, too.",) if named and more else (),
    )


def _share(before: float, after: float, floor: float) -> float | None:
    """Share of the explainable error that is explained; None where nothing is explainable."""
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


def _has_large_misfit(bare: Fitted, floor_degC: float) -> bool:
    """Whether the misfit is large compared with the sensors' deviation, and explainable."""
    if _undescribed(bare, None):
        return True
    deviation = np.sqrt(np.nanmean([np.nanvar(record.sensors) for record in bare.records]))
    large = bare.held_out_rmse_degC > max(_MIN_MISFIT_SHARE * deviation, _MIN_SD_DEGC)
    predicted = floor_degC < (1.0 - _MIN_EXPLAINABLE_SHARE) * bare.held_out_rmse_degC
    return bool(large and (predicted or _noise_degC(bare) < _MIN_EXPLAINABLE_SHARE * bare.rmse_degC))


def _noise_degC(fitted: Fitted) -> float:
    """White-noise part of the residual, from its sample-to-sample changes: a misfit with a cause is smoother."""
    steps = [np.diff(fitted.residual_degC(index), axis=1) for index in range(len(fitted.records))]
    return float(np.sqrt(np.nanmean(np.concatenate(steps, axis=1) ** 2) / 2))


def _undescribed(fitted: Fitted, share: float | None) -> bool:
    """Whether nine tenths of a sensor's deviation are left, or half of it, or much of all, where most of what can be
    explained is not."""
    worst, overall = _left(fitted)
    little = share is None or share < _MIN_EXPLAINED
    return worst > _MAX_ANY or (little and (worst > _MAX_WORST or overall > _MAX_OVERALL))


def _much_left(fitted: Fitted, share: float | None) -> bool:
    """Whether so much is left, or much of all, where a black box does better."""
    return _undescribed(fitted, share) or (share is not None and share < 1.0 and _left(fitted)[1] > _MAX_OVERALL)


def _left(fitted: Fitted) -> tuple[float, float]:
    """Ratio of the residual to the readings' deviation: at the worst sensor, and over all sensors."""
    read = np.concatenate([record.sensors for record in fitted.records], axis=1)
    square, variance = np.nanmean(residuals_degC(fitted) ** 2, axis=1), np.nanvar(read, axis=1)
    worst = np.sqrt(np.max(square / np.maximum(variance, _MIN_SD_DEGC**2)))
    return float(worst), float(np.sqrt(square.mean() / max(variance.mean(), _MIN_SD_DEGC**2)))


def _heat_halves_error(steps: Sequence[Step]) -> bool:
    """Whether a heat source as the first step removes more than half of the error."""
    heat = bool(steps) and steps[0].cause.name == "heat_source"
    return heat and steps[0].gain.rmse_after_degC < _HALF * steps[0].gain.rmse_before_degC


def _confounded(selection: Selection) -> bool:
    """Whether the first step is heat that nothing logged drives, or a body slower than the record, beside a reference
    that never moves: a warmer ambient does the same, within reason."""
    final = selection.final
    first = next((each for step in selection.steps for each in retained_mechanisms(step, selection)), None)
    if first is None or not ambient_is_constant(final.records):
        return False
    longest_s = max(record.samples * record.period_s for record in final.records)
    if first.cause == "thermal_mass":
        return _settles_in_s(first, final) > _SLOW_FRAC * longest_s
    if first.cause != "heat_source" or first.driver is not None:
        return False
    rises_degC = _rises_degC(first, final)
    largest = rises_degC[np.argmax(np.abs(rises_degC))]
    # a room warms, or cools, all that it holds alike: all the more what began at its temperature
    begins = _begins_at_ambient(final.records, _NEAR_AMBIENT_FRAC * abs(largest))
    alike = min(rises_degC * np.sign(largest)) > (_MIN_RATIO_FROM_REST if begins else _MIN_RATIO) * abs(largest)
    return bool(abs(largest) < _MAX_RISE_DEGC and (alike or (first.permanent and not begins)))


def _begins_at_ambient(records: Sequence[Record], within_degC: float) -> bool:
    """Whether all sensors read what the reference does at the beginning of every record."""
    apart = [each.sensors[:, 0] - each.signals.get(REFERENCE, np.zeros(1))[0] for each in records]
    return bool(np.abs(apart).max() < within_degC)


def _rises_degC(heat: Mechanism, fitted: Fitted) -> Array:
    """Steady-state temperature rise of each of the circuit's nodes by constant heat, with the constant losses."""
    network = fitted.model.network(fitted.records[0], fitted.model.z()[None])
    between, out = network.between[0], network.to_boundary[0].sum(axis=1)
    into = np.zeros(len(out))
    into[[network.index(each) for each in heat.places]] = [each.value for each in heat.numbers]
    steady = np.linalg.lstsq(np.diag(between.sum(axis=1) + out) - between, into)[0]
    return np.asarray(steady[: len(fitted.model.circuit.states)])


def _settles_in_s(mass: Mechanism, fitted: Fitted) -> float:
    """Time constant of a body to the ambient, directly and through its node."""
    network = fitted.model.network(fitted.records[0], fitted.model.z()[None])
    node, body = network.index(mass.places[0]), network.index(f"{mass.places[0]}_mass")
    loss = network.to_boundary[0].sum(axis=1)
    between = float(network.between[0, body, node])
    through = between * loss[node] / (between + loss[node]) if loss[node] > 0 else 0.0
    out = float(loss[body] + through)
    return float(network.capacitance[0, body]) / out if out > 0 else np.inf


def _check(circuit: Circuit, traces: Sequence[Trace]) -> None:
    plain = forward(circuit)
    faults = [each for trace in traces for each in _faults(plain, trace)]
    if faults:
        raise Refused("diagnose", faults)


def _faults(circuit: Circuit, trace: Trace) -> Iterator[Fault]:
    """What keeps a trace from being diagnosed: too few samples, a column without values, one that copies a sensor."""
    if (samples := len(trace.time_s)) < FEWEST_SAMPLES:
        hint = f"at least {FEWEST_SAMPLES} are needed: leave out less (--from, --to, --later), or log longer"
        yield Fault(trace.path, f"{samples} samples are too few for a diagnosis", hint)
        return
    sensors = [output.column for output in circuit.outputs]
    for name in (*circuit.inputs, *sensors):
        if np.isnan(trace.column(name)).all():
            yield Fault(trace.path, f"{name} holds no value", "log it, or take a circuit without it")
    for name in (each for each in circuit.inputs if each.endswith("_degC")):
        for sensor in sensors:
            apart = np.abs(trace.column(sensor) - trace.column(name))
            if (apart[~np.isnan(apart)] <= _ROUNDING_DEGC).all() and not np.isnan(apart).all():
                yield Fault(trace.path, f"{name} is {sensor}, value by value", "log what it stands for")
