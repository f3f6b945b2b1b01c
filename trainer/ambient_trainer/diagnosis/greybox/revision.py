"""Revision of earlier steps after later ones: close rivals are tried again, and needless mechanisms are dropped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.greybox.backward import score
from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN, SelectionStep, fault_margin
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit
from ambient_trainer.diagnosis.greybox.trials import PENALTY, Trial, assumed, complexity, identified, penalised
from ambient_trainer.diagnosis.greybox.windows import refine_timing

_NEAR, _RIVALS, _ELSEWHERE = 0.15, 3, 2
"""Penalised log error within which a rival is tried again; maximum number of rivals, and of other places."""


def revise(
    steps: Sequence[SelectionStep], fitted: Fitted, given: int, rivals: Callable[[SelectionStep], Iterator[Trial]]
) -> tuple[list[SelectionStep], Fitted] | None:
    """The steps with one of its ``rivals`` in the place of what was chosen, and the model with it; None where none does
    better.

    The first ``given`` mechanisms are the circuit's own.
    """
    for at, step in enumerate(steps):
        index = _index_in_model(step, fitted, given)
        if step.chosen is None or index is None:
            continue
        fits = ((each, _fit_with_rival(fitted, index, each)) for each in rivals(step))
        tried = {id(each): other for each, other in fits if other is not None}
        mine = fitted.model.mechanisms[index]
        better = [each for each in step.trials if id(each) in tried and _gains(fitted, mine, tried[id(each)], each)]
        if not better:
            continue
        rival = min(better, key=lambda each: score(tried[id(each)]))
        return [*steps[:at], _swap_chosen(step, rival, fitted, tried), *steps[at + 1 :]], tried[id(rival)]
    return None


def _index_in_model(step: SelectionStep, fitted: Fitted, given: int) -> int | None:
    """Where a model holds what a step has chosen, perhaps at fewer places; None where it does not, or builds on it."""
    held = (each for each in range(given, len(fitted.model.mechanisms)) if not fitted.model.carries(each))
    mechanisms = fitted.model.mechanisms
    return next((each for each in held if step.chosen and is_same(mechanisms[each], step.chosen.mechanism)), None)


def is_same(final: Mechanism, chosen: Mechanism) -> bool:
    """Whether a mechanism is one that was chosen, perhaps without places that were dropped since."""
    forms = [None if each.driver is None else each.driver.form for each in (final, chosen)]
    alike = final.cause == chosen.cause and forms[0] == forms[1] and set(final.places) <= set(chosen.places)
    return alike and final.permanent == chosen.permanent and final.overlaps(chosen)


def close_rivals(step: SelectionStep) -> Iterator[Trial]:
    """Rivals of a step with nearly the same score, the best form of each.

    What lasts, follows a log, or is physics stays before what acts for a while, follows none, or blames an instrument.
    What acts on a body stays out, since later steps may have changed or dropped that.
    """
    assert step.chosen is not None
    bodies = set(Context(step.before).hidden_nodes)
    mine, seen = step.chosen.mechanism, {step.chosen.mechanism.key}
    for each in sorted(step.trials, key=penalised):
        if len(seen) > _RIVALS or penalised(each) > penalised(step.chosen) + _NEAR:
            break
        its = each.mechanism
        if its.permanent < mine.permanent or its.endogenous > mine.endogenous:
            continue
        if its.instrument > mine.instrument and not step.before.records[0].known_good:
            continue
        if (its.driver is None and mine.driver is not None) or bodies & set(its.places):
            continue
        if its.key not in seen and not each.at_bounds:
            seen.add(its.key)
            yield each


def at_other_places(step: SelectionStep) -> Iterator[Trial]:
    """The same mechanism at other places: another missing cause may have hidden where it acts; bodies stay out, too."""
    assert step.chosen is not None
    bodies = set(Context(step.before).hidden_nodes)
    mine, seen = step.chosen.mechanism, {step.chosen.mechanism.places}
    for each in sorted(step.trials, key=penalised):
        its = each.mechanism
        if bodies & set(its.places):
            continue
        alike = (its.cause, its.key[2], its.permanent) == (mine.cause, mine.key[2], mine.permanent)
        single = len(its.places) == len(mine.places) == 1
        if alike and single and its.places not in seen and not each.at_bounds and len(seen) <= _ELSEWHERE:
            seen.add(its.places)
            yield each


def _fit_with_rival(fitted: Fitted, index: int, rival: Trial) -> Fitted | None:
    """A fit with a rival in place of one mechanism, and without windows that become needless."""
    model = fitted.model.replaced(index, rival.fitted.model.mechanisms[-1])
    other = fit(model, fitted.records, tolerance=1e-3, prior=fitted.prior)
    # a cause that is right may spare windows that stood in for it
    windows = sum(complexity(each) for each in fitted.model.mechanisms if not each.permanent)
    if other is None or other.rmse_degC > fitted.rmse_degC * np.exp(LEAST_GAIN + PENALTY * windows):
        return None
    other = other if rival.permanent else refine_timing(other, index)
    if any(each.at_bound for each in other.model.mechanisms[index].numbers) or not identified(other, index):
        return None
    return drop_needless_windows(other if fitted.validated is None else other.refitted(), index)


def _gains(fitted: Fitted, mine: Mechanism, other: Fitted, rival: Trial) -> bool:
    """Whether a model with a rival in place of one mechanism has a better penalised held-out error."""
    permanent = mine.permanent and rival.permanent
    before, after = (each.held_out.sum() if permanent else each.held_out_stretches.sum() for each in (fitted, other))
    spares = len(other.model.mechanisms) < len(fitted.model.mechanisms)
    blamed = rival.mechanism.instrument > mine.instrument and not spares
    least = np.log(fault_margin(fitted.records)) if blamed else LEAST_GAIN
    return bool(np.log(after / before) / 2 + PENALTY * (assumed(other.model) - assumed(fitted.model)) < -least)


def _swap_chosen(step: SelectionStep, rival: Trial, fitted: Fitted, tried: dict[int, Fitted]) -> SelectionStep:
    """The step with a rival chosen; what was tried again beside all others is as much worse as it is there."""
    assert step.chosen is not None
    rest = [each for each in step.trials if each is not rival]
    fits = {id(each): fitted for each in rest if each.mechanism.key == step.chosen.mechanism.key} | tried
    left = {id(each): _score_besides(fits[id(each)], each) for each in step.trials if id(each) in fits}
    best = left[id(rival)]
    worse = (
        replace(each, rmse_degC=rival.rmse_degC * float(np.exp(left[id(each)] - best))) if id(each) in left else each
        for each in rest
    )
    return replace(step, chosen=rival, trials=(rival, *worse))


def _score_besides(fitted: Fitted, trial: Trial) -> float:
    """Log in-sample error of a model, penalised for its complexity besides a trial's own mechanism."""
    return float(np.log(fitted.rmse_degC)) + PENALTY * (assumed(fitted.model) - complexity(trial.mechanism))


def _drop_each_place(mechanism: Mechanism) -> list[Mechanism]:
    """A mechanism with each of its places left out in turn, where each has its own parameters."""
    count = len(mechanism.places)
    if count < 2 or len(mechanism.numbers) % count:
        return []
    return [mechanism.at_places([each for each in range(count) if each != out]) for out in range(count)]


def prune(fitted: Fitted, given: int) -> Fitted:
    """The model without mechanisms, and places of heat, that later ones have made needless; the first ``given`` are the
    circuit's own."""
    model = fitted.model
    last = len(model.mechanisms) - 1
    for index, mechanism in list(enumerate(model.mechanisms))[given:]:
        # what acts for a while was gained on short stretches, and is judged by its folds: it has to be quite needless
        spare = complexity(mechanism) if mechanism.permanent else 0.0
        less = [] if model.carries(index) or index == last else [(model.without(index), spare)]
        if mechanism.cause == "heat_source":
            fewer = _drop_each_place(mechanism)
            less += [(model.replaced(index, each), spare - complexity(each)) for each in fewer]
        for each, spared in less:
            without = _fit_if_as_good(fitted, each, spared)
            if without is not None:
                return prune(without, given)
    return fitted


def drop_needless_windows(fitted: Fitted, kept: int) -> Fitted:
    """The model without what acts for a while and is needless, but for the mechanism at ``kept``."""
    for index, mechanism in enumerate(fitted.model.mechanisms):
        if mechanism.permanent or index == kept or fitted.model.carries(index):
            continue
        without = _fit_if_as_good(fitted, fitted.model.without(index), 0.0)
        if without is not None:
            return drop_needless_windows(without, kept - (index < kept))
    return fitted


def _fit_if_as_good(fitted: Fitted, less: GreyBox, spared: float) -> Fitted | None:
    """The fit of a model that assumes so much less, unless that is missed."""
    most = LEAST_GAIN / 2 + PENALTY * spared
    without = refit_as(fitted, less, float(np.exp(most + LEAST_GAIN)) * fitted.rmse_degC)
    missed = without is None or np.log(without.held_out_rmse_degC / fitted.held_out_rmse_degC) > most
    return None if missed else without


def refit_as(fitted: Fitted, model: GreyBox, most_degC: float = np.inf) -> Fitted | None:
    """Fit another model to the same records with the same validation; None where it leaves more than ``most_degC``."""
    other = fit(model, fitted.records, [None for _ in fitted.runs], tolerance=1e-3, prior=fitted.prior)
    if other is None or other.rmse_degC > most_degC:
        return None
    # to first order, or by fits without each fold
    return other if fitted.validated is None else other.refitted()
