"""Backward elimination: fit every cause that the log offers at once, then drop those that are not needed.

Heat by every column that may heat, constant heat, paths and bodies at all places are fitted together; then whatever the
held-out error does not miss is left out, one amount after the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN, SelectionStep
from ambient_trainer.diagnosis.greybox.context import THERMOELECTRIC, WARMING, Context
from ambient_trainer.diagnosis.greybox.expression import words_in
from ambient_trainer.diagnosis.greybox.mechanisms import heat, mass, path
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit
from ambient_trainer.diagnosis.greybox.trials import PENALTY, Trial, assumed, identified, starts_out_of_range

_HEATING = (*WARMING, "_frac", "_on", "_lux", "_A^2")
_MOST_NUMBERS, _SAMPLES_PER_NUMBER = 40, 10
"""Maximum number of parameters, and minimum samples per parameter, of a joint fit."""
_STARTED, _LAGS = 0.3, (1, 3)
"""Of a candidate's first amount; and which of the bodies' time constants."""
_TRIED, _MANY, _FEW = 4, 60, 20
"""Amounts that are tried without, the least sure ones; steps of the first fit, and of those with less."""


def score(fitted: Fitted) -> float:
    """Logarithm of the held-out error, penalised for the model's complexity."""
    return float(np.log(fitted.held_out_rmse_degC)) + PENALTY * assumed(fitted.model)


def eliminate_backward(bare: Fitted) -> Fitted | None:
    """What is left of everything, with or without bodies, which what is logged may heat first; None where that is too
    much for the record, or nothing."""
    context, given, found = Context(bare), len(bare.model.mechanisms), []
    samples = sum(record.samples for record in bare.records)
    heats, bodies = list(_heats(context)), _bodies(context)
    behind = [[each, *map(_move_behind, heats)] for each in bodies if any(heat.driver for heat in heats)]
    for some in (heats, *([each, *heats] for each in bodies), *behind):
        everything = [*some, *path.distinct(context)]
        model = bare.model
        for each in everything:
            model = model.with_mechanism(each.started([_STARTED] * len(each.probes())) or each)
        if not everything or len(model.numbers) > min(_MOST_NUMBERS, samples / _SAMPLES_PER_NUMBER):
            continue
        fitted = _fit(model, bare, _MANY)
        if fitted is not None:
            found.append(_drop_unidentified(_drop_needless(fitted.refitted(), given), given))
    return min((each for each in found if len(each.model.mechanisms) > given), key=score, default=None)


def steps_to(bare: Fitted, fitted: Fitted, tried: int) -> list[SelectionStep]:
    """The steps to a model whose mechanisms were found together, each beside all others; what is missed most first."""
    steps = []
    for index, mechanism in list(enumerate(fitted.model.mechanisms))[len(bare.model.mechanisms) :]:
        without, after = _without_and_reattach(fitted.model, index), fitted
        before = (without and _fit(without, fitted, _FEW)) or bare
        if without and not fitted.model.carries(index):
            after = _fit(without.with_mechanism(mechanism), fitted, _FEW) or fitted
        before = before.refitted()
        trial = replace(Trial.of(before, after.refitted()), mechanism=mechanism)
        steps.append(SelectionStep(before, trial, (), tried))
    return sorted(steps, key=lambda each: -each.before.held_out_rmse_degC)


def _without_and_reattach(model: GreyBox, index: int) -> GreyBox | None:
    """The model without a mechanism; what acts on its bodies acts on the nodes before them. None where something acts
    on bodies behind those, or beside them."""
    gone = model.mechanisms[index]
    nodes = {f"{place}_mass": place for place in gone.places if gone.adds_nodes}
    known = {*nodes, *(node.name for node in model.circuit.states)}
    if not all(known.issuperset(each.places) for each in model.carried(index)):
        return None
    moved = (replace(each, places=tuple(nodes.get(at, at) for at in each.places)) for each in model.mechanisms)
    return replace(model, mechanisms=tuple(moved)).without(index)


def _fit(model: GreyBox, near: Fitted, most: int) -> Fitted | None:
    starts = [run.start[: len(near.model.circuit.states)] for run in near.runs]
    return fit(model, near.records, starts, most=most, tolerance=1e-3, prior=near.prior)


def _drop_needless(fitted: Fitted, given: int) -> Fitted:
    """Remove amounts, then paths and bodies, whose removal does not worsen the penalised error."""
    for model in _smaller_models(fitted, given):
        without = _fit(model, fitted, _FEW)
        if without is None:
            continue
        most = score(fitted) + LEAST_GAIN
        without = without.refitted(float(np.exp(most - PENALTY * assumed(without.model))))
        if score(without) <= most:
            return _drop_needless(without, given)
    return fitted


def _drop_unidentified(fitted: Fitted, given: int) -> Fitted:
    """Remove mechanisms that are not identified, and bodies that start out of the range of known temperatures."""
    apart = starts_out_of_range(fitted)
    for index, each in list(enumerate(fitted.model.mechanisms))[given:]:
        if (not identified(fitted, index) or (apart and each.adds_nodes)) and not fitted.model.carries(index):
            without = _fit(fitted.model.without(index), fitted, _FEW)
            return fitted if without is None else _drop_unidentified(_drop_needless(without.refitted(), given), given)
    return fitted


def _smaller_models(fitted: Fitted, given: int) -> Iterator[GreyBox]:
    """Models with an amount of heat less, the least sure ones, or with a path or a body less."""
    model, others = fitted.model, []
    sure: list[tuple[float, int, GreyBox]] = []
    deviation = np.sqrt(np.maximum(np.diag(fitted.covariance), 1e-300))
    for index, mechanism in list(enumerate(model.mechanisms))[given:]:
        span = model.span(index)
        if mechanism.cause != "heat_source":
            others += [] if model.carries(index) else [model.without(index)]
            continue
        for place, (number, sd) in enumerate(zip(mechanism.numbers, deviation[span])):
            kept = [each for each in range(len(mechanism.places)) if each != place]
            less = model.replaced(index, mechanism.at_places(kept)) if kept else model.without(index)
            sure.append((0.0 if number.at_bound else abs(number.z) / sd, len(sure), less))
    yield from (each for _, _, each in sorted(sure)[:_TRIED])
    yield from others


def _heats(context: Context) -> Iterator[Mechanism]:
    """Constant heat at all places, and heat by each column that may heat."""
    for each in heat.candidates(context):
        text = "" if each.driver is None else each.driver.text
        plain = each.driver is None or each.driver.columns == (text.removesuffix("^2"),)
        heats = not text or text.endswith(_HEATING) or not THERMOELECTRIC.isdisjoint(words_in(text))
        if each.places == tuple(context.nodes) and type(each) is heat.Heat and plain and heats:
            yield each


def _move_behind(heating: Mechanism) -> Mechanism:
    """Heat by a log in the bodies behind its nodes: a heater's own, or a cell's core."""
    if heating.driver is None:
        return heating
    return replace(heating, places=tuple(f"{each}_mass" for each in heating.places))


def _bodies(context: Context) -> Sequence[Mechanism]:
    """A body behind every node, quick or slow."""
    bodies = [
        each
        for each in mass.candidates(context)
        if each.places == tuple(context.nodes) and len(each.numbers) == 2 * len(each.places)
    ]
    return [bodies[each] for each in _LAGS]
