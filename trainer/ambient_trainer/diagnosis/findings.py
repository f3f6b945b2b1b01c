"""Findings of a selection: steps with cause, size, gain and confidence, and the ranking of all candidates."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
from scipy.stats import norm, wilcoxon

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.choice import (
    ENDOGENOUS_PENALTY,
    MAX_UNEXPLAINED_BY_WINDOW,
    MIN_CORRELATION,
    SelectionStep,
    coincides_with,
    collinear,
    correlation,
    fault_margin,
    leaves_offset_steps,
    unexplained_by_window,
)
from ambient_trainer.diagnosis.greybox.context import LIGHT, Context
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.model import Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted
from ambient_trainer.diagnosis.greybox.revision import is_same, refit_as
from ambient_trainer.diagnosis.greybox.stepwise import Selection
from ambient_trainer.diagnosis.greybox.trials import Trial, penalised
from ambient_trainer.diagnosis.misfit import in_watts
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import UNKNOWN, Cause, Gain, Magnitude, Ranked, Step
from ambient_trainer.report.words import digits, window

_ALIKE = 0.04
"""Of the penalised logarithm of held-out errors: rivals that are closer are not distinguishable."""
_CONFIDENCE_IF_VISIBLE, _RESAMPLED = 0.95, 400
_EVERYWHERE = ("ambient_coupling", "convection_law")
"""Without a location they are those of all nodes."""
_NO_POWERS, _AS_POWERS = ("_V", "_rpm", "_krpm", "_MHz", "_GHz"), ("_W", "_kW", "_A", "_load", "_frac", "_pct")
"""Units of columns that heat follows though they are none, and of those that are powers or go along with one."""
_CURVES = ("thermal_mass", "convection_law")
"""What bends a node's way to a temperature that stays."""
_CENTRE, _SLOPE = 0.05, 8.0
"""Of the margin over the closest other cause, in the logarithm of the held-out error: 57 verdicts of ``discover``."""
_AMBIGUITY = 0.6
"""Of the confidence in a fault that heat could be as well: readings jump where water begins to flow, too, in a measured
heater, and in a measured box one sensor's drift and heat that creeps read the same; another box, which had come to
rest at 30 degC, seemed to melt there. Six measured sensors seemed to lag where a logged heater's body may, and five
losses seemed to differ in the heat."""


def steps_of(selection: Selection, longest: int) -> tuple[Step, ...]:
    """The steps whose mechanisms the final model holds; numbers are those of the final model."""
    final = selection.final
    result: list[Step] = []
    windows: list[tuple[Mechanism, float]] = []
    held = list(range(len(selection.bare.model.mechanisms), len(final.model.mechanisms)))
    for step in selection.steps:
        chosen = step.chosen
        found = [each for each in held if chosen and is_same(final.model.mechanisms[each], chosen.mechanism)]
        if chosen is None or not found:
            continue
        index = found[0]
        held.remove(index)
        mechanism = final.model.mechanisms[index]
        without = fitted_without(final, index)
        gain = _gain(step.before, chosen.fitted, chosen, step.tried)
        if gain.ci95_degC[0] <= 0 and without is not None:
            # what an earlier step finds may show itself only beside what later ones do
            gain = _gain(without, final, chosen, step.tried)
        confidence = _confidence(step, chosen, final, _log_error_without(without, final, index))
        if mechanism.driver is None and not mechanism.permanent:
            # a window may make up for what an earlier one is wrong about
            confidence = min(
                [confidence, *(sure for each, sure in windows if set(each.places) & set(mechanism.places))]
            )
            windows.append((mechanism, confidence))
        magnitude, parameters = _numbers(final, index)
        rivals = [cause_of(each.mechanism, final.model.circuit) for each in step.trials if _is_rival(each, chosen)]
        cause, when = cause_of(mechanism, final.model.circuit), (mechanism.onset_s, mechanism.end_s)
        size = f"{magnitude.meaning} {digits(magnitude.value)} {magnitude.unit}"
        interval = " to ".join(map(digits, magnitude.ci95))
        qualifier = f"{magnitude.qualifier}, " if magnitude.qualifier else ""
        sentence = (
            f"{cause}: {size} ({interval}), {qualifier}{window(*when)}; on held-out data"
            f" {gain.rmse_before_degC:.2f} becomes {gain.rmse_after_degC:.2f} degC."
        )
        alike = tuple(dict.fromkeys([*rivals, *_equivalent_physics(chosen)]))
        residual_degC = chosen.fitted.residual_degC(longest)
        result.append(Step(cause, *when, magnitude, confidence, gain, alike, sentence, parameters, residual_degC))
    return tuple(result)


def retained_mechanisms(step: SelectionStep, selection: Selection) -> list[Mechanism]:
    """The mechanisms of the final model that a step has chosen."""
    added = selection.final.model.mechanisms[len(selection.bare.model.mechanisms) :]
    return [] if step.chosen is None else [each for each in added if is_same(each, step.chosen.mechanism)]


def residuals_degC(fitted: Fitted) -> Array:
    """Measured minus simulated of all records, (s, samples); NaN where nothing was measured."""
    return np.concatenate([fitted.residual_degC(index) for index in range(len(fitted.records))], axis=1)


def cause_of(mechanism: Mechanism, circuit: Circuit) -> Cause:
    """Its name, place and driver, as a diagnosis gives them."""
    places = mechanism.places
    location: str | tuple[str, ...] | None = places[0] if len(places) == 1 else places or None
    joined = {each for each, _ in circuit.to_ambient(circuit.states)}
    if len(places) > 1 and mechanism.cause in _EVERYWHERE and joined == set(places):
        location = None
    return Cause(mechanism.cause, location, None if mechanism.driver is None else mechanism.driver.text)


def _numbers(final: Fitted, index: int) -> tuple[Magnitude, dict[str, tuple[float, str]]]:
    mechanism, span = final.model.mechanisms[index], final.model.span(index)
    covariance = final.covariance[span, span]
    intervals = []
    for number, variance in zip(mechanism.numbers, np.diag(covariance)):
        error = 1.96 * math.sqrt(max(variance, 0.0))
        ends = (float(number.natural(np.float64(number.z + sign * error))) for sign in (-1.0, 1.0))
        low, high = sorted(mechanism.stated(each) for each in ends)
        intervals.append((low, high))
    parameters = {number.name: (number.value, number.unit) for number in mechanism.numbers}
    if (whole := mechanism.product()) is not None:
        magnitude = _product(mechanism, whole, covariance)
        parameters[magnitude.meaning.replace(" ", "_")] = (magnitude.value, magnitude.unit)
        return _scaled(magnitude, final), parameters
    # amounts in one unit by their size, others by their coordinates
    same = len({number.unit for number in mechanism.numbers}) == 1
    size = [abs(n.value if same else n.z) * (not n.log) for n in mechanism.numbers]
    largest = size.index(max(size))
    main, tail = mechanism.numbers[largest], mechanism.sentence_tail()
    value, meaning = mechanism.stated(main.value), mechanism.meaning(main)
    return _scaled(Magnitude(value, main.unit, meaning, intervals[largest], tail), final), parameters


def _scaled(magnitude: Magnitude, final: Fitted) -> Magnitude:
    """``magnitude``, qualified where its scale is heat's, which no power, resistance or capacitance determines."""
    if not magnitude.unit.startswith(("W", "J", "K/W")) or in_watts(final.model.circuit):
        return magnitude
    qualifier = f"on the scale of the circuit's own capacitances, {magnitude.qualifier}".removesuffix(", ")
    return replace(magnitude, qualifier=qualifier, scale_known=False)


def _product(mechanism: Mechanism, whole: tuple[str, str, tuple[int, int]], covariance: Array) -> Magnitude:
    meaning, unit, both = whole
    z = sum(mechanism.numbers[each].z for each in both)
    error = 1.96 * math.sqrt(max(float(covariance[np.ix_(both, both)].sum()), 0.0))
    low, high = (math.exp(min(z + sign * error, 60.0)) for sign in (-1.0, 1.0))
    return Magnitude(math.exp(z), unit, meaning, (low, high), mechanism.sentence_tail())


def _gain(before: Fitted, after: Fitted, trial: Trial, tried: int) -> Gain:
    """The held-out errors, with the interval of their difference by resampling blocks of time.

    What acts for a while is resampled by stretches that are short beside it: each gains its share.
    """
    was, left = (_squares(each, trial.permanent) for each in (before, after))
    error = before.held_out_rmse_degC, trial.rmse_degC if after is trial.fitted else after.held_out_rmse_degC
    gain = error[0] - error[1]
    p_value = 1.0
    if np.any(was != left):
        p_value = min(1.0, float(wilcoxon(was, left, alternative="greater").pvalue) * max(tried, 1))
    drawn = np.random.default_rng(0).integers(len(was), size=(_RESAMPLED, len(was)))
    gains = np.sqrt(was[drawn].mean(axis=1)) - np.sqrt(left[drawn].mean(axis=1))
    middle = float(np.sqrt(was.mean()) - np.sqrt(left.mean()))
    low, high = (gain + float(each) - middle for each in np.quantile(gains, [0.025, 0.975]))
    return Gain(*error, (low, high), p_value)


def _squares(fitted: Fitted, by_block: bool) -> Array:
    """The mean square of each block of time, or of each short stretch."""
    residual, part = fitted.residual, fitted.block if by_block else fitted.stretch
    return np.array([np.mean(residual[part == each] ** 2) for each in np.unique(part)])


def _is_rival(trial: Trial, chosen: Trial) -> bool:
    """Whether a trial of another cause, or by a driver collinear with the chosen one's, fits nearly as well."""
    if chosen.mechanism.visible_in_readings or leaves_offset_steps(chosen, trial):
        return False
    one, other = trial.mechanism, chosen.mechanism
    another = one.key != other.key and (one.cause != other.cause or _are_collinear(one, other, chosen.fitted.records))
    same = (one.instrument, one.endogenous) == (other.instrument, other.endogenous) or _is_offset_for_heat(one, other)
    return another and same and not trial.at_bounds and penalised(trial) - penalised(chosen) < _ALIKE


def _confidence(step: SelectionStep, chosen: Trial, final: Fitted, needed: float = math.inf) -> float:
    """Probability that cause, place and driver are right, from the margin over the closest cause not in the model,
    and from the error that grows without it at the end, ``needed``."""
    if chosen.mechanism.visible_in_readings:
        return _CONFIDENCE_IF_VISIBLE
    sound = [each for each in step.trials if not each.at_bounds]
    there = [chosen.mechanism, *final.model.mechanisms]
    held = partial(_is_in_model, there, step.before, final.records)
    others = [each for each in sound if not (held(each.mechanism) or leaves_offset_steps(chosen, each))]
    # what stands for the cause chosen has beaten the others for it
    same = [penalised(each) for each in sound if _is_equivalent(each.mechanism, chosen.mechanism, final.records)]
    best = min([penalised(chosen), *same])
    margin = min((penalised(each) + _penalty(each, chosen) - best for each in others), default=1.0)
    total = min(step.gain, needed)
    sure = float(norm.cdf(2.0 * total / 0.35 - 0.5)) * (_AMBIGUITY if _is_ambiguous(step, chosen, final) else 1.0)
    sure *= max(1.0 - (unexplained_by_window(step.before, chosen) / MAX_UNEXPLAINED_BY_WINDOW) ** 2, 0.0)
    return min(0.98, sure / (1.0 + math.exp(-_SLOPE * (min(margin, total) - _CENTRE))))


def _is_ambiguous(step: SelectionStep, chosen: Trial, final: Fitted) -> bool:
    """Whether a quite different cause gives the same readings, or no alternative was tried."""
    mechanism, records = chosen.mechanism, final.records
    # later steps may have moved its numbers
    doubtful = any(each.ambiguous for each in final.model.mechanisms if is_same(each, mechanism))
    if mechanism.step_like or doubtful or _equivalent_physics(chosen) or not step.trials:
        return True
    # without known-good records, what nothing logged shows and that begins or ends describes more than it names; and
    # a loss that differs in the heat: of five in measured logs none was surely that
    if mechanism.driver is not None:
        bent = mechanism.cause == "convection_law" and not records[0].known_good
        return bent or (mechanism.cause == "heat_source" and _is_proxy(mechanism.driver, records))
    begins = not (mechanism.permanent or records[0].known_good)
    return begins or ((mechanism.cause == "heat_source" or mechanism.slow) and ambient_is_constant(records))


def _is_proxy(driver: Expression, records: Sequence[Record]) -> bool:
    """Whether heat follows what is no power, while a power, a current or a load is logged that moves as well: a
    processor's voltage and a motor's speed went along with those in measured logs that begin with a few loads."""
    if not driver.columns[0].endswith(_NO_POWERS):
        return False
    return any(name.endswith(_AS_POWERS) and np.ptp(row) > 0 for each in records for name, row in each.signals.items())


def ambient_is_constant(records: Sequence[Record]) -> bool:
    """Whether the ambient is constant: constant heat, or a slow body, may then be another room's temperature."""
    return bool(records) and not any(np.ptp(each.signals.get(REFERENCE, np.zeros(1))) > 0 for each in records)


def fitted_without(final: Fitted, index: int) -> Fitted | None:
    """A model without a mechanism, fitted; None where that is all that it has, or others act on its bodies."""
    alone = len(final.model.mechanisms) == 1 or final.model.carries(index)
    return None if alone else refit_as(final, final.model.without(index))


def _log_error_without(without: Fitted | None, final: Fitted, index: int) -> float:
    """By how much the logarithm of the held-out error grows where one mechanism of a model is left out."""
    if without is None:
        return math.inf
    if final.model.mechanisms[index].permanent:
        return math.log(without.held_out_rmse_degC / final.held_out_rmse_degC)
    # of short stretches, as it was chosen by
    return math.log(without.held_out_stretches.sum() / final.held_out_stretches.sum()) / 2


def _equivalent_physics(trial: Trial) -> tuple[Cause, ...]:
    """What reads the same as one sensor's drift or lag: heat that grows with time, where its node exchanges heat with
    no other sensor's, and a body of the heater's own, where something logged heats the node. As a reference that is
    off: constant heat at all nodes; that is late where the ambient repeats itself: heat by day that nothing logged
    shows. As a body, where nothing logged moves: a loss that bends, and the other way round. As heat by what a module
    makes of the sun: the sun."""
    cause, fitted = trial.mechanism.cause, trial.fitted
    if cause == "heat_source" and (light := _collinear_light(trial.mechanism, fitted)):
        return tuple(replace(cause_of(trial.mechanism, fitted.model.circuit), signal=each) for each in light)
    if cause in _CURVES and trial.mechanism.driver is None and not any(map(_has_excitation, fitted.records)):
        return tuple(Cause(each, trial.mechanism.places[0], None) for each in _CURVES if each != cause)
    if (cause, trial.mechanism.places) == ("sensor_bias", (AMBIENT,)):
        return (Cause("heat_source", None, None),)
    if trial.mechanism.of_reference:
        return (Cause("heat_source", None, None),) if math.isfinite(Context(fitted).repeats_s(REFERENCE)) else ()
    if cause not in ("sensor_drift", "sensor_lag"):
        return ()
    network = fitted.model.network(fitted.records[0], fitted.model.z()[None])
    index = int(network.reads[network.sensors.index(trial.mechanism.places[0])])
    node = network.nodes[index]
    if cause == "sensor_lag":
        heats = [each for each in fitted.model.mechanisms if each.cause == "heat_source" and each.driver is not None]
        return (Cause("thermal_mass", node, None),) if any(node in each.places for each in heats) else ()
    others = [int(each) for each in network.reads if each != index]
    return () if network.between[0, index, others].any() else (Cause("heat_source", node, "time_s"),)


def _collinear_light(mechanism: Mechanism, fitted: Fitted) -> list[str]:
    """The logged light that is collinear with a driver of heat that is not light itself."""
    if mechanism.driver is None or mechanism.driver.columns[0].endswith(LIGHT):
        return []
    light = [each for each in Context(fitted).columns if each.endswith(LIGHT)]
    records = fitted.records
    return [each for each in light if collinear(replace(mechanism, driver=Expression(each)), mechanism, records)]


def _has_excitation(record: Record) -> bool:
    """Whether the ambient, or any other logged input, changes."""
    inputs = (row for name, row in record.signals.items() if name == REFERENCE or not name.endswith("_degC"))
    return any(np.ptp(row) > 0 for row in inputs)


def _is_in_model(there: Sequence[Mechanism], before: Fitted, records: Sequence[Record], other: Mechanism) -> bool:
    """Whether another mechanism says the same as one that is there: by itself, or as the rest of it, where the same by
    the same driver was at its other places before."""
    cause, places, driver = other.key
    same = [each.places for each in before.model.mechanisms if driver and (each.cause, each.key[2]) == (cause, driver)]
    whole = replace(other, places=tuple(dict.fromkeys(chain(places, *same))))
    return any(
        _is_equivalent(other, each, records)
        or (set(places) <= set(each.places) and _is_equivalent(whole, each, records))
        for each in there
    )


def _is_equivalent(one: Mechanism, other: Mechanism, records: Sequence[Record]) -> bool:
    """Whether ``one`` has the same cause, driven by the same columns or their twins, there and perhaps elsewhere.

    What nothing logged drives has to act at about the same time.
    """
    if one.cause != other.cause or not set(one.places) >= set(other.places):
        return False
    if one.driver is None and other.driver is None:
        same = one.permanent == other.permanent
        return same and (one.permanent or correlation(one, other, records) > MIN_CORRELATION)
    if one.driver is None and not one.permanent:
        return coincides_with(one, other, records)
    columns = [() if each.driver is None else each.driver.columns for each in (one, other)]
    return columns[0] == columns[1] or _are_collinear(one, other, records)


def _are_collinear(one: Mechanism, other: Mechanism, records: Sequence[Record]) -> bool:
    """Whether both have the same cause at the same places, by collinear logged drivers."""
    alike = (one.cause, one.places) == (other.cause, other.places) and one.permanent and other.permanent
    return alike and one.driver is not None and other.driver is not None and collinear(one, other, records)


def _penalty(other: Trial, chosen: Trial) -> float:
    """Penalty on a sensor fault, and on an endogenous driver, compared with a physical cause."""
    if other.mechanism.endogenous and not chosen.mechanism.endogenous:
        return math.log(ENDOGENOUS_PENALTY)
    blamed = other.mechanism.instrument and not chosen.mechanism.instrument
    judged = blamed and not _is_offset_for_heat(other.mechanism, chosen.mechanism)
    return math.log(fault_margin(chosen.fitted.records)) if judged else 0.0


def _is_offset_for_heat(one: Mechanism, other: Mechanism) -> bool:
    """Whether ``one`` is an offset of the sensor where ``other`` is constant heat: the same rise in a steady state."""
    constant = other.cause == "heat_source" and other.driver is None and one.cause == "sensor_bias"
    return constant and one.places == other.places and one.permanent and other.permanent


def ranking_of(selection: Selection, named: bool) -> tuple[Ranked, ...]:
    """Every candidate for the first step, each compared by itself, in its best form; none is taken where none is
    ``named``."""
    taken = {each.chosen.mechanism.key for each in selection.steps[:1] if each.chosen is not None and named}
    best: dict[object, Trial] = {}
    for trial in selection.compared.trials:
        mechanism = trial.mechanism
        best.setdefault((mechanism.key, mechanism.onset_s, mechanism.end_s), trial)
    return tuple(_ranked(selection.compared, trial, taken) for trial in best.values())


def _ranked(step: SelectionStep, trial: Trial, taken: set[tuple[str, tuple[str, ...], str]]) -> Ranked:
    mechanism, gain = trial.mechanism, _gain(step.before, trial.fitted, trial, step.tried)
    magnitude, _ = _numbers(trial.fitted, len(trial.fitted.model.mechanisms) - 1)
    best = step.chosen and (step.chosen.mechanism.key, step.chosen.permanent)
    if mechanism.key in taken:
        remark = "taken"
    elif trial.at_bounds:
        remark = "a parameter ends at a physical bound"
    elif taken and best == (mechanism.key, trial.permanent):
        remark = "best single cause; the causes taken fit better together"
    elif step.chosen is not None and _is_rival(trial, step.chosen):
        remark = "fits as well as the one taken"
    elif gain.rmse_after_degC > gain.rmse_before_degC * 0.95:
        remark = "gain on held-out data not significant"
    elif mechanism.endogenous:
        remark = "a logged temperature that may respond to the same cause"
    elif mechanism.instrument:
        remark = "a sensor fault, but a physical cause fits nearly as well"
    else:
        remark = "smaller gain on held-out data" if step.chosen else "gain too small to matter"
    cause = cause_of(mechanism, trial.fitted.model.circuit)
    return Ranked(cause, mechanism.onset_s, mechanism.end_s, magnitude, gain, remark)


def unknown_step(bare: Fitted, longest: int) -> Step:
    """The step of a misfit that nothing explains."""
    error = bare.held_out_rmse_degC
    gain = Gain(error, error, (0.0, 0.0), 1.0)
    sentence = f"The simulation's error is {error:.2f} degC (RMSE)."
    return Step(Cause(UNKNOWN), None, None, None, 0.0, gain, (), sentence, {}, bare.residual_degC(longest))
