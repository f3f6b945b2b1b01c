"""Earlier steps are revised by later ones: what did nearly as well may do better beside what was found since."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN, Step, worse_physics
from ambient_trainer.diagnosis.greybox.model import Mechanism
from ambient_trainer.diagnosis.greybox.pruning import pruned
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.greybox.trials import PENALTY, Trial, complexity, identified, penalised
from ambient_trainer.diagnosis.greybox.windows import sharpened

_NEAR, _RIVALS = 0.15, 3
"""Of the penalised logarithm of the error: a rival that is nearer is tried again, and so many at most."""


def revised(steps: Sequence[Step], fitted: Fitted, given: int) -> tuple[list[Step], Fitted] | None:
    """The steps with a rival in the place of what was chosen, and the model with it; None where none does better.

    The first ``given`` mechanisms are the circuit's own.
    """
    for at, step in enumerate(steps):
        index = _held_at(step, fitted, given)
        if step.chosen is None or index is None:
            continue
        fits = ((each, _instead(fitted, index, each, given)) for each in _near(step))
        tried = {id(each): other for each, other in fits if other is not None}
        better = [each for each in step.trials if id(each) in tried and _gains(fitted, tried[id(each)], index, each)]
        if not better:
            continue
        rival = min(better, key=lambda each: tried[id(each)].held_out_rmse_degC)
        return [*steps[:at], _otherwise(step, rival, fitted, tried), *steps[at + 1 :]], tried[id(rival)]
    return None


def _held_at(step: Step, fitted: Fitted, given: int) -> int | None:
    """Where a model holds what a step has chosen, perhaps at fewer places; None where it does not, or builds on it."""
    held = (each for each in range(given, len(fitted.model.mechanisms)) if not fitted.model.carries(each))
    mechanisms = fitted.model.mechanisms
    return next((each for each in held if step.chosen and is_chosen(mechanisms[each], step.chosen.mechanism)), None)


def is_chosen(final: Mechanism, chosen: Mechanism) -> bool:
    """Whether a mechanism is one that was chosen, perhaps without places that were dropped since."""
    forms = [None if each.driver is None else each.driver.form for each in (final, chosen)]
    return final.cause == chosen.cause and forms[0] == forms[1] and set(final.places) <= set(chosen.places)


def _near(step: Step) -> Iterator[Trial]:
    """The rivals of a step that do nearly as well, the best form of each.

    What lasts, follows a log, or is physics stays before what acts for a while, follows none, or blames an instrument.
    What acts on a body stays out, since later steps may have changed or dropped that.
    """
    assert step.chosen is not None
    bodies = set(Scene(step.before).hidden_nodes)
    mine, seen = step.chosen.mechanism, {step.chosen.mechanism.key}
    for each in sorted(step.trials, key=penalised):
        if len(seen) > _RIVALS or penalised(each) > penalised(step.chosen) + _NEAR:
            break
        its = each.mechanism
        if its.lasts < mine.lasts or its.responds > mine.responds:
            continue
        if its.instrument > mine.instrument and not step.before.records[0].known_good:
            continue
        if (its.driver is None and mine.driver is not None) or bodies & set(its.places):
            continue
        if its.key not in seen and not each.at_bounds:
            seen.add(its.key)
            yield each


def _instead(fitted: Fitted, index: int, rival: Trial, given: int) -> Fitted | None:
    """A fit with a rival in the place of one mechanism, and without those that it makes needless."""
    model = fitted.model.replaced(index, rival.fitted.model.mechanisms[-1])
    other = fit(model, fitted.records, tolerance=1e-3, prior=fitted.prior)
    # a cause that is right may spare windows that stood in for it
    windows = sum(complexity(each) for each in fitted.model.mechanisms[given:] if not each.lasts)
    if other is None or other.rmse_degC > fitted.rmse_degC * np.exp(LEAST_GAIN + PENALTY * windows):
        return None
    other = other if rival.lasting else sharpened(other, index)
    return pruned(other if fitted.validated is None else other.refitted(), given, index)


def _gains(fitted: Fitted, other: Fitted, index: int, rival: Trial) -> bool:
    """Whether another mechanism in the place of one is sound and does better, by what both models assume."""
    mine = fitted.model.mechanisms[index]
    at = next(at for at, each in enumerate(other.model.mechanisms) if is_chosen(each, rival.mechanism))
    its = other.model.mechanisms[at]
    if any(each.at_bound for each in its.numbers) or not identified(other, at):
        return False
    lasting = mine.lasts and its.lasts
    before, after = (each.held_out.sum() if lasting else each.combed.sum() for each in (fitted, other))
    assumed, instead = (sum(map(complexity, each.model.mechanisms)) for each in (fitted, other))
    blamed = its.instrument > mine.instrument and len(other.model.mechanisms) == len(fitted.model.mechanisms)
    least = np.log(worse_physics(fitted.records)) if blamed else LEAST_GAIN
    return bool(np.log(after / before) / 2 + PENALTY * (instead - assumed) < -least)


def _otherwise(step: Step, rival: Trial, fitted: Fitted, tried: dict[int, Fitted]) -> Step:
    """The step with a rival chosen; what was tried again beside all others is as much worse as it is there."""
    assert step.chosen is not None
    best = np.log(tried[id(rival)].rmse_degC)
    rest = [each for each in step.trials if each is not rival]
    left = {id(each): np.log(tried[id(each)].rmse_degC) for each in rest if id(each) in tried}
    left |= {id(each): np.log(fitted.rmse_degC) for each in rest if each.mechanism.key == step.chosen.mechanism.key}
    worse = (
        replace(each, rmse_degC=rival.rmse_degC * float(np.exp(left[id(each)] - best))) if id(each) in left else each
        for each in rest
    )
    return replace(step, chosen=rival, trials=(rival, *worse))
