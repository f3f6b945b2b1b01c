"""Selection of two mechanisms at once: either gains little alone, or two heaters were taken for one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, product

import numpy as np

from ambient_model.trace import split_column
from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN, Limits, SelectionStep, collinear, gains
from ambient_trainer.diagnosis.greybox.context import LIGHT, Context
from ambient_trainer.diagnosis.greybox.model import Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit, fit_near
from ambient_trainer.diagnosis.greybox.screening import Offered, Screened, permanent_candidates, screen, shortlist
from ambient_trainer.diagnosis.greybox.trials import PENALTY, Trial, complexity, fit_candidates, identified, penalised
from ambient_trainer.diagnosis.greybox.windows import Columns

ABOVE_FLOOR = 2.0
_PAIRED, _LITTLE, _MUCH = 4, 0.7, 1 / 3
"""Number of first trials to which a second is added; share of the error above which one gains little, and above which
it may be unlogged heat: a measured rig's valve left 0.53, a printer's heater, rightly, 0.12."""
_OWN = 0.1
"""Of the held-out error's logarithm: by how much two heaters, each at its own place, may do worse than one at both,
where they leave less in sample. In a short log both go up together. In three measured sets of four they were worse by
less, and held better later; in the fourth by 0.6, and did not."""

Progress = Callable[[str, int, int], None]


def fit_pair(
    step: SelectionStep, beside: Sequence[Fitted], limits: Limits, offered: Offered, progress: Progress
) -> list[SelectionStep]:
    """Two steps at once where one alone gains little, or nothing logged drives it: heat and the mass that stores it,
    heat by a driver and what is there without it, or that and a loss by a driver show themselves together.

    Each is then compared with the model that holds the other alone.
    """
    error = step.before.held_out_rmse_degC
    single = error if step.chosen is None else step.chosen.rmse_degC
    chosen = None if step.chosen is None else step.chosen.mechanism
    enough = single < min(_LITTLE * error, ABOVE_FLOOR * limits.floor_degC)
    # as long as a mass is missing a driver may do better than its square
    squared = chosen is not None and f"{chosen.key[2]}^2" in {each.mechanism.key[2] for each in step.trials}
    if chosen is not None and (chosen.visible_in_readings or (enough and chosen.driver is not None and not squared)):
        return []
    # heat that nothing logged drives may stand for a driver and for what is there without it, or hide it
    unlogged = chosen is None or _is_constant_heat(chosen) or single > _MUCH * error
    firsts = _first_candidates(step, unlogged)
    total = len(firsts) + len(beside) * sum(_is_constant_heat(each.mechanism) for each in firsts)
    alone = float(np.log(error)) if step.chosen is None else penalised(step.chosen)
    best: tuple[float, Trial, Trial, list[Trial]] | None = None
    begun = chain(_add_second(firsts, chosen, offered, unlogged), _refit_from_points(step, firsts, beside))
    for index, (first, seconds) in enumerate(begun):
        progress("try pairs", index, total)
        rivals = fit_candidates(first.fitted, shortlist(seconds), lambda done, total: None)
        for second in rivals:
            score = penalised(second) + PENALTY * complexity(first.mechanism)
            sound = _are_identified(first, second, limits)
            if sound and first is step.chosen:
                # it is followed anyway
                alone = min(alone, score)
            elif sound and (best is None or score < best[0]):
                best = score, first, second, rivals
    if best is None or best[0] > alone - LEAST_GAIN or not gains(step.before, best[2], limits.least_degC):
        return []
    return _two_steps(step, *best[1:])


def _first_candidates(step: SelectionStep, unlogged: bool) -> list[Trial]:
    """The best trials of heat and of masses, at one place and at several, for each driver; one for all light."""
    begun: dict[object, Trial] = {}
    for each in [*([step.chosen] if step.chosen else []), *sorted(step.trials, key=penalised)]:
        if _is_storage_or_heat(each.mechanism, unlogged):
            cause, places, driver = each.mechanism.key
            begun.setdefault((cause, len(places) > 1, "sun" if driver.endswith(LIGHT) else driver), each)
    return list(begun.values())[:_PAIRED]


def _add_second(
    firsts: Sequence[Trial], chosen: Mechanism | None, offered: Offered, unlogged: bool
) -> Iterator[tuple[Trial, list[Screened]]]:
    """Each of ``firsts``, and what may go with it; with a loss that is another from some time on, the column alone that
    does best by itself: any other that goes along with what heats did better in two measured logs."""
    for first in firsts:
        best = chosen is not None and _columns(first.mechanism) == _columns(chosen) != ()
        screened = screen(Context(first.fitted), offered if best else permanent_candidates)
        yield first, [each for each in screened if _may_pair_with(each.mechanism, first.mechanism, unlogged)]


def _columns(mechanism: Mechanism) -> tuple[str, ...]:
    return () if mechanism.driver is None else mechanism.driver.columns


def _may_pair_with(second: Mechanism, first: Mechanism, unlogged: bool) -> bool:
    """Whether two may show themselves together alone: of two heats by drivers each does so by itself, but a driver's
    rate only beside it."""
    driven = first.key[2]
    if _changes_loss(second):
        return True
    other = second.key != first.key and _is_storage_or_heat(second, unlogged or bool(driven))
    return other and (not driven or second.key[2] in ("", f"d({driven})/dt"))


def _refit_from_points(
    step: SelectionStep, firsts: Sequence[Trial], beside: Sequence[Fitted]
) -> Iterator[tuple[Trial, list[Screened]]]:
    """Constant heat of ``firsts`` as it is fitted from other points, and losses by a driver: alone it drives time
    constants to where no loss shows."""
    for first, point in product([each for each in firsts if _is_constant_heat(each.mechanism)], beside):
        started = screen(Context(point), partial(_with_same_key, first.mechanism))
        model = point.model.with_mechanism(started[0].mechanism) if started else None
        fitted = model and fit(model, step.before.records, tolerance=1e-3, prior=step.before.prior)
        if fitted:
            losses = [each for each in screen(Context(fitted), permanent_candidates) if _changes_loss(each.mechanism)]
            yield Trial.of(step.before, fitted), losses


def _with_same_key(mechanism: Mechanism, context: Context, columns_of: Columns) -> Iterator[Mechanism]:
    return (each for each in permanent_candidates(context, columns_of) if each.key == mechanism.key)


def fit_separately(step: SelectionStep, limits: Limits) -> list[SelectionStep]:
    """Two steps where heat by one driver at several places does hardly better than with another driver of the same
    unit at one of them: two heaters, each at its own place."""
    if step.chosen is None or not _is_heat_at_several(step.chosen.mechanism):
        return []
    chosen, mechanism = step.chosen, step.chosen.mechanism
    best: tuple[float, Trial, Trial, list[Trial]] | None = None
    for index, place in enumerate(mechanism.places):
        rest = mechanism.at_places([each for each in range(len(mechanism.places)) if each != index])
        fitted = fit_near(step.before, step.before.model.with_mechanism(rest))
        if fitted is None:
            continue
        first = Trial.of(step.before, fitted)
        kin = partial(_heaters, place, mechanism)
        rivals = fit_candidates(fitted, screen(Context(fitted), kin), lambda done, total: None)
        for second in (each for each in rivals if not collinear(each.mechanism, mechanism, step.before.records)):
            score = penalised(second) + PENALTY * complexity(rest) - penalised(chosen)
            own = len(mechanism.places) == 2 and second.fitted.rmse_degC < chosen.fitted.rmse_degC
            better = score < (_OWN if own else -LEAST_GAIN) and _are_identified(first, second, limits)
            if better and (best is None or score < best[0]):
                best = score, first, second, rivals
    return [] if best is None else _two_steps(step, *best[1:])


def step_given_second(step: SelectionStep, first: Trial, second: Trial) -> SelectionStep:
    """The step of ``first`` given ``second``: compared with the model that has ``second`` alone."""
    alone = (each for each in sorted(step.trials, key=penalised) if each.permanent)
    before = next((each.fitted for each in alone if each.mechanism.key == second.mechanism.key), step.before)
    together = replace(first, fitted=second.fitted, rmse_degC=second.rmse_degC)
    return SelectionStep(before, together, step.trials, step.tried)


def _are_identified(first: Trial, second: Trial, limits: Limits) -> bool:
    """Whether the numbers of both are identified, and off their bounds, and the second gains beside the first: what
    only seems to gain, as a window in what wanders by itself, is not followed."""
    before = len(second.fitted.model.mechanisms) - 2
    free = not any(number.at_bound for each in second.fitted.model.mechanisms[before:] for number in each.numbers)
    sound = free and not second.at_bounds and second.identified and identified(second.fitted, before)
    return sound and gains(first.fitted, second, limits.least_degC)


def _two_steps(step: SelectionStep, first: Trial, second: Trial, rivals: Sequence[Trial]) -> list[SelectionStep]:
    """What is logged before what stores it, either beside the model that holds the other alone; what comes second is
    compared with what else goes with the first."""
    if first.mechanism.driver is not None or second.mechanism.driver is None:
        return [step_given_second(step, first, second), SelectionStep(first.fitted, second, tuple(rivals), step.tried)]
    stored = step_given_second(step, first, second)
    screened = screen(Context(stored.before), permanent_candidates)
    others = shortlist([each for each in screened if _is_storage_or_heat(each.mechanism, True)])
    storing = fit_candidates(stored.before, others, lambda done, total: None)
    heated = SelectionStep(first.fitted, second, (*rivals, *step.trials), step.tried)
    return [heated, replace(stored, trials=tuple(storing))]


def _is_storage_or_heat(mechanism: Mechanism, unlogged: bool) -> bool:
    """Whether it is heat by a driver, or ``unlogged`` by none, or from a temperature that is given, or a mass, all the
    time."""
    heat = mechanism.cause == "heat_source" and (unlogged or mechanism.driver is not None)
    return (heat or mechanism.exogenous or mechanism.cause == "thermal_mass") and mechanism.permanent


def _is_constant_heat(mechanism: Mechanism) -> bool:
    """Whether it is heat without a logged driver."""
    return mechanism.cause == "heat_source" and mechanism.driver is None


def _changes_loss(mechanism: Mechanism) -> bool:
    """Whether it is a changed loss, in a window or by a driver."""
    return mechanism.cause == "ambient_coupling"


def _is_heat_at_several(mechanism: Mechanism) -> bool:
    """Whether it is permanent heat by one logged column at several places."""
    return _is_heat_by_column(mechanism) and len(mechanism.places) > 1


def _heaters(place: str, mechanism: Mechanism, context: Context, columns_of: Columns) -> Iterator[Mechanism]:
    """Candidates of heat into a place by columns in the unit of the driver of ``mechanism``."""
    for each in permanent_candidates(context, columns_of):
        if _is_heat_by_column(each) and each.places == (place,) and _unit(each) == _unit(mechanism):
            yield each


def _is_heat_by_column(mechanism: Mechanism) -> bool:
    heats = mechanism.cause == "heat_source" and mechanism.permanent
    return heats and mechanism.driver is not None and mechanism.driver.columns == (mechanism.driver.text,)


def _unit(mechanism: Mechanism) -> str:
    return split_column(mechanism.key[2])[1]
