"""Joint fits of candidates with all parameters, their held-out error, and a complexity penalty."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import ThreadpoolController

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism, Number
from ambient_trainer.diagnosis.greybox.regression import Fitted, Prior, fit, fit_near
from ambient_trainer.diagnosis.greybox.screening import Screened, effect_columns, ends_within
from ambient_trainer.diagnosis.greybox.windows import best_window, refine_timing
from ambient_trainer.diagnosis.record import Record

PENALTY = 0.04
"""Penalty on the logarithm of the held-out error, per unit of complexity."""
_FEW, _MANY, _FINALISTS = 5, 25, 4
_FINE, _COARSE = 5e-4, 3e-3
"""Of the cost: what a step of a fit gains, when it ends."""
_MAX_SCORE_GAP = 0.25
_LOOPED = 2500
_TWO_SIDED_95, _MAX_FACTOR = 1.96, 100.0
_MOST_RELOCATIONS = 2
_BEGINS, _BEGINS_DEGC = 0.25, 8.0
"""Of the span of the readings, and at least: a hidden body begins no further beyond the temperatures that are known
then. What nothing heats lies between them: true bodies of eight measured sets begin within 0.12 of the span."""


@dataclass(frozen=True)
class Trial:
    """A candidate that was fitted jointly with all numbers."""

    mechanism: Mechanism
    fitted: Fitted
    rmse_degC: float
    """Held-out."""
    at_bounds: bool
    """Whether a number of it, or an earlier amount that had stood free, ends at a physical bound, or a body begins
    beyond one."""

    @property
    def permanent(self) -> bool:
        """Whether it acts all the time."""
        return self.mechanism.permanent

    @property
    def identified(self) -> bool:
        """Whether its numbers are."""
        return identified(self.fitted, len(self.fitted.model.mechanisms) - 1)

    @staticmethod
    def of(before: Fitted, after: Fitted) -> Trial:
        """The last mechanism of ``after``; one that acts for a while is scored on short stretches."""
        mechanism, error = after.model.mechanisms[-1], after.held_out_rmse_degC
        if not mechanism.permanent:
            error = after.by_stretches_degC(before)
        # an earlier time constant may well turn out to be longer than the record
        new = after.at_bounds - before.at_bounds
        numbers, own = after.model.numbers, len(after.model.numbers) - len(mechanism.numbers)
        bounded = any(index >= own or not numbers[index].log for index in new)
        bounded = bounded or starts_out_of_range(after)
        return Trial(mechanism, after, error if np.isfinite(error) else float("inf"), bounded)


def starts_out_of_range(fitted: Fitted) -> bool:
    """Whether an added body starts far outside of the temperatures known at that time."""
    own = len(fitted.model.circuit.states)
    if not any(each.adds_nodes for each in fitted.model.mechanisms):
        return False
    for record, run in zip(fitted.records, fitted.runs):
        network = fitted.model.network(record, fitted.model.z()[None])
        known = [row[np.isfinite(row)] for row in record.sensors]
        first = [*(each[0] for each in known if len(each)), *network.boundary_degC[:, 0]]
        room = max(_BEGINS * float(np.ptp(np.concatenate(known))), _BEGINS_DEGC)
        if run.start[own:].min() < min(first) - room or run.start[own:].max() > max(first) + room:
            return True
    return False


def identified(fitted: Fitted, index: int) -> bool:
    """Whether an amount of a mechanism is significant, or its conductance is known to a factor of a hundred; for heat
    and paths each of them."""
    mechanism = fitted.model.mechanisms[index]
    first = len(fitted.model.own) + sum(len(each.numbers) for each in fitted.model.mechanisms[:index])
    variance = np.diag(fitted.covariance)[first : first + len(mechanism.numbers)]
    deviations = np.sqrt(np.maximum(variance, 0.0))
    sure = [_is_significant(*each) for each in zip(mechanism.numbers, deviations)]
    if mechanism.by_place:
        return all(sure)
    amounts = [each for each, number in zip(sure, mechanism.numbers) if not number.log]
    return any(amounts) or (mechanism.numbers[0].log and sure[0])


def _is_significant(number: Number, deviation: float) -> bool:
    if number.log:
        return bool(_TWO_SIDED_95 * deviation < np.log(_MAX_FACTOR))
    return abs(number.z) > _TWO_SIDED_95 * deviation


def fit_candidates(before: Fitted, screened: Sequence[Screened], progress: Callable[[int, int], None]) -> list[Trial]:
    """Joint fits with each candidate from where it was screened, best first: a few steps for all, more for the best.

    They run side by side in as many processes as joblib is configured for.
    """
    total = len(screened) + _FINALISTS
    begun = [(each.point.model.with_mechanism(each.mechanism), each.point) for each in screened]
    trials: list[Trial] = []
    for done, result in enumerate(_in_parallel(_refit, begun, _FEW)):
        progress(done, total)
        if result is not None:
            trials.append(Trial.of(before, result))
    known = {each.mechanism.key for each in trials}
    heating = [(each, less) for each in trials if (less := _drop_insignificant_places(each)) and less.key not in known]
    fewer = [(before.model.with_mechanism(less), each.fitted) for each, less in heating]
    joined = _joint_starts(before, trials)
    trials += [Trial.of(before, each) for each in _in_parallel(_refit, [*fewer, *joined], _FEW) if each is not None]
    trials.sort(key=_promise)
    worth = [each for each in trials[:_FINALISTS] if _promise(each) < _promise(trials[0]) + _MAX_SCORE_GAP]
    finalists = [(each.fitted.model, each.fitted) for each in worth]
    for index, result in enumerate(_in_parallel(_refit_and_validate, finalists, _MANY)):
        progress(len(screened) + index, total)
        if result is not None:
            trials[index] = Trial.of(before, result)
    return sorted(trials[: len(worth)], key=penalised) + sorted(trials[len(worth) :], key=penalised)


def _in_parallel(
    function: Callable[..., Fitted | None], tasks: Sequence[tuple[GreyBox, Fitted]], most: int
) -> Iterator[Fitted | None]:
    calls = (
        delayed(function)(model, near.records, [run.start for run in near.runs], near.prior, most)
        for model, near in tasks
    )
    results: Iterator[Fitted | None] = Parallel(return_as="generator", max_nbytes=None)(calls)
    return results


@cache
def _libraries() -> ThreadpoolController:
    """What may use threads in this process: to look for it at each trial takes longer than many a fit."""
    return ThreadpoolController()


def _refit(
    model: GreyBox, records: Sequence[Record], starts: Sequence[Array], prior: Prior, most: int
) -> Fitted | None:
    linear = not model.network(records[0], model.z()[None]).nonlinear
    with _libraries().limit(limits=1):
        # without a loop over samples steps cost little, and valleys are followed to their ends
        tolerance = _FINE if linear or most > _FEW else _COARSE
        return fit(model, records, starts, most=4 * most if linear else most, tolerance=tolerance, prior=prior)


def _refit_and_validate(*given: Any) -> Fitted | None:
    done = _refit(*given)
    if done is None:
        return None
    with _libraries().limit(limits=1):
        if not done.model.mechanisms[-1].permanent:
            # where a sensor stands still its readings show, but for the samples in which that begins and ends
            done = refine_timing(done if done.model.mechanisms[-1].visible_in_readings else _relocate_window(done))
        return done.refitted() if is_cheap(done) else done


def _relocate_window(fitted: Fitted) -> Fitted:
    """The same with the window of its last mechanism placed anew beside its other numbers, which it has moved."""
    for _ in range(_MOST_RELOCATIONS):
        model, last = fitted.model.without(len(fitted.model.mechanisms) - 1), fitted.model.mechanisms[-1]
        beside = fit_near(fitted, model, most=0)
        if beside is None:
            break
        window = best_window(beside, last, effect_columns(beside), closed=all(ends_within(last)))
        if window is None or window == last or ends_within(window) != ends_within(last):
            break
        again = fit_near(fitted, model.with_mechanism(window), _FEW, tolerance=3e-3)
        if again is None or again.rmse_degC > fitted.rmse_degC:
            break
        fitted = again
    return fitted


def is_cheap(fitted: Fitted) -> bool:
    """Whether refitting without each fold is affordable: no loop over samples, or few of them."""
    network = fitted.model.network(fitted.records[0], fitted.model.z()[None])
    return not network.nonlinear or sum(record.samples for record in fitted.records) < _LOOPED


def _drop_insignificant_places(trial: Trial) -> Mechanism | None:
    """Heat into several places, or several paths, without those whose amount is at a bound, or not surely one; None
    where all are."""
    mechanism, numbers = trial.mechanism, trial.mechanism.numbers
    if not mechanism.by_place or len(mechanism.places) != len(numbers) or len(numbers) == 1:
        return None
    deviations = np.sqrt(np.maximum(np.diag(trial.fitted.covariance)[-len(numbers) :], 0.0))
    sure = [n.z > n.range_z[0] and _is_significant(n, sd) for n, sd in zip(numbers, deviations)]
    kept = [index for index, each in enumerate(sure) if each]
    return mechanism.at_places(kept) if 0 < len(kept) < len(numbers) else None


def _joint_starts(before: Fitted, trials: Sequence[Trial]) -> list[tuple[GreyBox, Fitted]]:
    """What acts at several places, each place begun where it is best by itself; all moves from ``before`` are added.

    One start for all places ends in a mixture of their valleys.
    """
    alone: dict[tuple[type, int], dict[tuple[str, ...], Trial]] = {}
    for each in sorted(trials, key=_promise):
        its = each.mechanism
        if its.multistart and its.permanent and not its.instrument and len(its.places) == 1:
            kind = type(its), len(its.numbers)
            alone.setdefault(kind, {}).setdefault(its.places, each)
    joined = {}
    for each in trials:
        kind = type(each.mechanism), len(each.mechanism.numbers) // max(len(each.mechanism.places), 1)
        parts = [alone.get(kind, {}).get((place,)) for place in each.mechanism.places]
        if len(parts) > 1 and (known := [part for part in parts if part is not None]) == parts:
            joined[kind] = _superposed(before, each.mechanism, known)
    return list(joined.values())


def _superposed(before: Fitted, mechanism: Mechanism, parts: Sequence[Trial]) -> tuple[GreyBox, Fitted]:
    numbers = tuple(number for part in parts for number in part.mechanism.numbers)
    z = before.model.z()
    own = z + sum(part.fitted.model.z()[: len(z)] - z for part in parts)
    runs = []
    for index, run in enumerate(before.runs):
        count, starts = len(run.start), [part.fitted.runs[index].start for part in parts]
        moved = run.start + sum(start[:count] - run.start for start in starts)
        runs.append(replace(run, start=np.concatenate([moved, *(start[count:] for start in starts)])))
    model = before.model.at(own).with_mechanism(replace(mechanism, numbers=numbers))
    return model, replace(before, runs=tuple(runs))


def _promise(trial: Trial) -> float:
    """In-sample score by which trials get a full fit: after few iterations the held-out error is unreliable."""
    return float(np.log(trial.fitted.rmse_degC)) + PENALTY * complexity(trial.mechanism)


def complexity(mechanism: Mechanism) -> float:
    """Complexity of a mechanism: its parameters, its driver's terms, and further assumptions."""
    text = "" if mechanism.driver is None else mechanism.driver.text
    driver = (
        0.5 * bool(text)
        + 1.5 * text.count("*")
        + 0.5 * text.count("/dt")
        + 2.5 * mechanism.tuned
        # a voltage may be a meter's
        + 0.5 * (text.count("^") - text.endswith("_A^2") + 2 * text.endswith("_V^2"))
    )
    bounds = 2.5 * ((mechanism.onset_s is not None) + (mechanism.end_s is not None))
    return 0.5 + mechanism.assumes + 0.5 * len(mechanism.numbers) + driver + bounds


def assumed(model: GreyBox) -> float:
    """Total complexity of a model's mechanisms."""
    return sum(map(complexity, model.mechanisms))


def penalised(trial: Trial) -> float:
    """Logarithm of the held-out error, penalised for complexity."""
    return float(np.log(trial.rmse_degC)) + PENALTY * complexity(trial.mechanism)
