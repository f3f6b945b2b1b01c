"""Stepwise selection: mechanisms are screened, fitted, compared and added; those that become needless are dropped."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.diagnosis.greybox.backward import steps_to
from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN, UNLIMITED, Limits, SelectionStep, choose
from ambient_trainer.diagnosis.greybox.conducted import conducted
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.pairs import ABOVE_FLOOR, Progress, fit_pair, fit_separately, step_given_second
from ambient_trainer.diagnosis.greybox.regression import Fitted, Prior, fit
from ambient_trainer.diagnosis.greybox.revision import at_other_places, close_rivals, prune, revise
from ambient_trainer.diagnosis.greybox.screening import (
    Offered,
    Screened,
    every_candidate,
    permanent_candidates,
    screen,
    shortlist,
)
from ambient_trainer.diagnosis.greybox.trials import Trial, fit_candidates, is_cheap
from ambient_trainer.diagnosis.greybox.windows import refine_timing
from ambient_trainer.diagnosis.record import Record

_log = logging.getLogger(__name__)

MOST_STEPS = 6
_BELOW_FLOOR = 0.55


@dataclass(frozen=True)
class Selection:
    """The circuit by itself, the model with what it lacked, and the steps between; the last may have chosen nothing.

    ``compared`` is the first step with every candidate by itself, whatever was added together.
    """

    bare: Fitted
    final: Fitted
    steps: tuple[SelectionStep, ...]
    compared: SelectionStep


def stepwise(
    bare: Fitted,
    beside: Sequence[Fitted] = (),
    limits: Limits = UNLIMITED,
    progress: Progress | None = None,
    offered: Offered = every_candidate,
) -> Selection:
    """The model with what it lacks.

    The first candidates are screened at the points ``beside``, too.
    """
    return _select(Selection(bare, bare, (), SelectionStep(bare, None, (), 0)), beside, limits, progress, offered)


def continued(
    found: Selection, together: Fitted, beside: Sequence[Fitted], limits: Limits, progress: Progress | None = None
) -> Selection:
    """The model whose mechanisms were found together, with what that lacks; compared is what ``found`` compared.

    Each is compared with what else does beside all others.
    """
    steps: list[SelectionStep] = []
    for step in steps_to(found.bare, together, found.compared.tried):
        report = partial(_numbered, progress or _no_progress, len(steps) + 1)
        rivals = replace(step, trials=_screen_and_fit([step.before], every_candidate, report)[1])
        steps.append(_compact(rivals) if steps else rivals)
    return _select(replace(found, final=together, steps=tuple(steps)), beside, limits, progress, every_candidate)


def _select(
    begun: Selection, beside: Sequence[Fitted], limits: Limits, progress: Progress | None, offered: Offered
) -> Selection:
    report = progress or _no_progress
    bare, fitted, given = begun.bare, begun.final, len(begun.bare.model.mechanisms)
    steps, compared = list(begun.steps), begun.compared if begun.steps else None
    while len(steps) < MOST_STEPS:
        points = [fitted] if steps else [fitted, *beside]
        step = _select_next(points, limits, offered, partial(_numbered, report, len(steps) + 1))
        compared = compared or step
        pairs = [fit_separately(step, limits), conducted(step)]
        # what goes with heat at several places says nothing where that is at one of them
        if not pairs[-1] and beside and (not steps or _stuck(step, limits)):
            pairs.append(fit_pair(step, points[1:], limits, offered, partial(_numbered, report, len(steps) + 1)))
        found = [(each[-1].chosen.rmse_degC, each) for each in pairs if each and each[-1].chosen]
        steps += min(found, key=itemgetter(0))[1] if found else [_compact(step) if steps else step]
        last = steps[-1].chosen
        if last is not None:
            _log.info("%s: %.3f -> %.3f", last.mechanism, fitted.held_out_rmse_degC, last.rmse_degC)
            fitted = prune(last.fitted, given)
            if (moved := revise(steps[:-1], fitted, given, at_other_places)) is not None:
                steps, fitted = [*moved[0], steps[-1]], moved[1]
            continue
        coarse_degC, fitted = fitted.held_out_rmse_degC, _refine_tuned(fitted, given)
        finer = fitted.held_out_rmse_degC < np.exp(-LEAST_GAIN) * coarse_degC
        again = revise(steps[:-1], fitted, given, close_rivals)
        if again is not None:
            steps, fitted = again
        elif finer:
            # a delay or a level on its grid may have hidden something
            steps.pop()
        else:
            break
    else:
        fitted = _refine_tuned(fitted, given)
    return Selection(bare, fitted, tuple(_order_logged_first(steps)), compared or begun.compared)


def _stuck(step: SelectionStep, limits: Limits) -> bool:
    """Whether no single mechanism gains, although a black box with the same inputs leaves much less."""
    return step.chosen is None and step.before.held_out_rmse_degC > ABOVE_FLOOR * limits.floor_degC


def _refine_tuned(fitted: Fitted, given: int) -> Fitted:
    """The same with delays and levels refined beside what was added since, where less is left of held-out data.

    The first ``given`` are the circuit's own. Zones of a loss, which stand on a grid till then, are refined here alone.
    """
    for index, each in list(enumerate(fitted.model.mechanisms))[given:]:
        if each.driver is not None and each.driver.level is not None:
            again = refine_timing(fitted, index)
            again = again if fitted.validated is None else again.refitted()
            fitted = min(fitted, again, key=lambda each: each.held_out_rmse_degC)
    return fitted


def _compact(step: SelectionStep) -> SelectionStep:
    """The same with the errors of its trials alone."""
    return replace(step, trials=tuple(replace(each, fitted=each.fitted.without_slopes()) for each in step.trials))


def _order_logged_first(steps: Sequence[SelectionStep]) -> Sequence[SelectionStep]:
    """With heat by a logged driver before heat that is there without one, where these are the first two."""
    first, second = (*(step.chosen for step in steps[:2]), None, None)[:2]
    if first is None or second is None or not (first.permanent and second.permanent):
        return steps
    heats = first.mechanism.cause == second.mechanism.cause == "heat_source"
    if not heats or first.mechanism.driver is not None or second.mechanism.driver is None:
        return steps
    return [steps[1], step_given_second(steps[0], first, second), *steps[2:]]


def _no_progress(stage: str, done: int, total: int) -> None:
    pass


def _numbered(report: Progress, number: int, stage: str, done: int, total: int) -> None:
    report(f"fit effect {number}: {stage}", done, total)


def _select_next(points: Sequence[Fitted], limits: Limits, offered: Offered, report: Progress) -> SelectionStep:
    """One step from the first of ``points``; candidates are screened beside each."""
    fitted = points[0]
    tried, trials = _screen_and_fit(points, offered, report)
    chosen = choose(fitted, trials, limits.least_degC)
    # what a black box leaves says nothing of readings that jump or stand still
    visible = chosen is not None and (chosen.mechanism.step_like or chosen.mechanism.visible_in_readings)
    if chosen is not None and not visible and fitted.held_out_rmse_degC < limits.floor_degC:
        small = chosen.rmse_degC > _BELOW_FLOOR * fitted.held_out_rmse_degC
        # nor does it of a late reference, which only what comes later shows
        blamed = chosen.mechanism.instrument and not chosen.mechanism.of_reference
        chosen = None if small or blamed else chosen
    if chosen is not None and chosen.mechanism.tuned:
        again = refine_timing(chosen.fitted)
        finer = Trial.of(fitted, again.refitted() if is_cheap(again) else again)
        chosen = min(chosen, finer, key=lambda each: each.rmse_degC)
    return SelectionStep(fitted, chosen, trials, tried)


def _screen_and_fit(points: Sequence[Fitted], offered: Offered, report: Progress) -> tuple[int, tuple[Trial, ...]]:
    """How many candidates were screened beside ``points``, and the best of them, each fitted beside the first point."""
    screened: list[Screened] = []
    for index, point in enumerate(points):
        report("screen", index, len(points))
        screened += screen(Context(point), permanent_candidates if index else offered)
    screened.sort(key=lambda each: each.held_out)
    trials = fit_candidates(points[0], shortlist(screened), partial(report, "try"))
    _log.debug("\n".join(f"{each.rmse_degC:.3f} {each.fitted.rmse_degC:.3f} {each.mechanism}" for each in trials))
    return len({each.mechanism.key for each in screened}), tuple(trials)


def anchors(model: GreyBox, records: Sequence[Record]) -> list[Fitted]:
    """The unfitted circuit, as given and with time constants ten times off: candidates can be detected here where a
    missing cause drives the fit to absurd time constants."""
    points = (fit(_slower(model, factor), records, most=0, prior=Prior.of(model)) for factor in (1.0, 10.0, 0.1))
    return [each for each in points if each is not None]


def _slower(model: GreyBox, factor: float) -> GreyBox:
    """The model with every free time constant times ``factor``."""
    unit = "J/K" if any(each.unit == "J/K" for each in model.own) else "K/W"
    z = model.z()
    z[: len(model.own)] += [np.log(factor) if each.unit == unit else 0.0 for each in model.own]
    return model.at(z)


def bare_fit(model: GreyBox, records: Sequence[Record]) -> Fitted:
    """The circuit itself at its least squares, from several starts."""
    fits = (fit(_slower(model, factor), records, prior=Prior.of(model)) for factor in (1.0, 10.0, 0.1, 100.0))
    simulated = [each for each in fits if each is not None]
    if not simulated:
        hint = "check the units of its columns, and readings that no sensor can have"
        raise refuse("diagnose", model.circuit.name, "cannot be simulated on this trace", hint)
    return min(simulated, key=lambda each: each.rmse_degC).refitted()
