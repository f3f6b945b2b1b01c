"""Conduction tree: heat at one place, conducted to the others by paths, instead of heat at several places.

The paths make a tree. It grows by the one that leaves least; then each is exchanged while that leaves less: of places
in a row the outer ones may have been joined first, or what it led to has a heater of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from ambient_trainer.diagnosis.greybox.backward import score, steps_to
from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN, SelectionStep
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.mechanisms import path
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit_near
from ambient_trainer.diagnosis.greybox.trials import PENALTY, Trial, assumed, identified, penalised
from ambient_trainer.diagnosis.record import Record

_MOST_PLACES, _ORIGINS = 6, 2
"""With more the exchanges take long; and places from which trees grow, those that explain most alone."""
_FEW, _MANY = 10, 30
"""Steps of a fit, and of the last one."""
_HEAT = "heat_source"
_LESS = 0.99
"""Maximum ratio of the in-sample error after an exchange to that before it."""


def conducted(step: SelectionStep) -> list[SelectionStep]:
    """Heat at one place and each path from there, as steps, where that does better than heat at several; else none."""
    if step.chosen is None or not _is_heat_at_several(step.chosen.mechanism):
        return []
    heat, before = step.chosen.mechanism, step.before
    context = Context(before)
    if any(context.has_a_heater(place, heat.driver) for place in heat.places):
        return []
    paths = [each for each in path.distinct(context) if set(each.ends) <= set(heat.places)]
    given = len(before.model.mechanisms)
    heated = (_fit_with(before, before.model, heat.at_places([index])) for index in range(len(heat.places)))
    likely = sorted((each for each in heated if each is not None), key=_in_sample_degC)[:_ORIGINS]
    grown = [_grow_tree(each, paths) for each in likely]
    trees = [_fit_to_convergence(each) for each in grown if each is not None and len(each.model.mechanisms) > given + 1]
    if not trees:
        return []
    sources = [*paths, *(heat.at_places([index]) for index in range(len(heat.places)))]
    joined = _exchange_sources(min(trees, key=_in_sample_degC), given + 1, paths)
    apart = _exchange_sources(joined, given + 1, sources)
    # without a path it is heat at several places, which it is compared with
    mixed = apart is not joined and any(each.cause == path.Path.cause for each in apart.model.mechanisms[given:])
    tree = min((_fit_to_convergence(each).refitted() for each in ([joined, apart] if mixed else [joined])), key=score)
    added = range(given, len(tree.model.mechanisms))
    sound = all(identified(tree, index) for index in added) and not tree.at_bounds - before.at_bounds
    several = penalised(step.chosen) + PENALTY * assumed(before.model)
    if not sound or score(tree) > several - LEAST_GAIN:
        return []
    return [replace(each, trials=tuple(_rivals(each, step, sources))) for each in steps_to(before, tree, step.tried)]


def _is_heat_at_several(mechanism: Mechanism) -> bool:
    """Whether it is heat by a driver at several places, all the time."""
    several = 1 < len(mechanism.places) <= _MOST_PLACES
    return several and mechanism.cause == _HEAT and mechanism.permanent and mechanism.driver is not None


def _grow_tree(fitted: Fitted | None, paths: Sequence[path.Path]) -> Fitted | None:
    """Grow a tree path by path until every place that the paths can join is joined."""
    while fitted is not None and (apart := list(_joining_sources(fitted.model, fitted.records[0], paths))):
        longer = (_fit_with(fitted, fitted.model, each) for each in apart)
        fitted = min((each for each in longer if each is not None), key=_in_sample_degC, default=None)
    return fitted


def _exchange_sources(tree: Fitted, first: int, sources: Sequence[Mechanism]) -> Fitted:
    """Exchange sources from ``first`` on one at a time until no exchange lowers the error."""
    for index in range(first, len(tree.model.mechanisms)):
        other = min(_swap_source(tree, index, sources), key=_in_sample_degC, default=tree)
        if _in_sample_degC(other) < _LESS * _in_sample_degC(tree):
            return _exchange_sources(other, first, sources)
    return tree


def _swap_source(tree: Fitted, index: int, sources: Sequence[Mechanism]) -> Iterator[Fitted]:
    """Fits with one source replaced by each other that keeps the tree connected."""
    without = tree.model.without(index)
    others = _joining_sources(without, tree.records[0], sources)
    others = (each for each in others if each.key != tree.model.mechanisms[index].key)
    yield from (fitted for each in others if (fitted := _fit_with(tree, without, each)) is not None)


def _rivals(found: SelectionStep, step: SelectionStep, sources: Sequence[Mechanism]) -> Iterator[Trial]:
    """What else does: heat at several places, or other sources beside all others; in the place of heat that by other
    drivers, too, which what is beside it would help as much."""
    assert found.chosen is not None
    assert step.chosen is not None
    fitted, mechanism, heat = found.chosen.fitted, found.chosen.mechanism, step.chosen.mechanism
    if mechanism.cause == path.Path.cause:
        yield step.chosen
    else:
        gain = found.chosen.rmse_degC / step.chosen.rmse_degC
        same = (heat.key[2], mechanism.cause)
        for each in step.trials:
            alike = (each.mechanism.key[2], each.mechanism.cause) == same
            yield each if alike else replace(each, rmse_degC=gain * each.rmse_degC)
    for other in _swap_source(fitted, len(fitted.model.mechanisms) - 1, sources):
        yield Trial.of(found.before, other.refitted())


def _joining_sources(model: GreyBox, record: Record, sources: Sequence[Mechanism]) -> Iterator[Mechanism]:
    """Sources that connect separate parts of the tree: a path two nodes, heat a node and its driver."""
    network = model.network(record, model.z()[None])
    heats = {each.key[2] for each in sources if each.cause == _HEAT}
    alike = (each for each in model.mechanisms if each.cause == _HEAT and each.key[2] in heats)
    joined = np.pad(network.between[0] > 0, (0, 1))  # the last is the driver
    joined[[network.index(place) for each in alike for place in each.places], -1] = True
    _, part = connected_components(joined, directed=False)
    for each in sources:
        ends = [network.index(end) for end in (each.ends if isinstance(each, path.Path) else each.places)]
        if len(set(part[ends if len(ends) > 1 else [*ends, -1]])) > 1:
            yield each


def _fit_with(near: Fitted, model: GreyBox, mechanism: Mechanism) -> Fitted | None:
    return fit_near(near, model.with_mechanism(mechanism), _FEW)


def _fit_to_convergence(tree: Fitted) -> Fitted:
    return fit_near(tree, tree.model, _MANY) or tree


def _in_sample_degC(fitted: Fitted) -> float:
    return fitted.rmse_degC
