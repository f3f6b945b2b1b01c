"""Which explanations an experiment has to distinguish; a survey where none explains the misfit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ambient_trainer.diagnosis.causes import claim
from ambient_trainer.diagnosis.experiment.difference import Hypothesis, Limits, largest_difference
from ambient_trainer.diagnosis.experiment.plan import Intervention, bench_of, plans
from ambient_trainer.diagnosis.experiment.sentence import Wording, listed, rest, span, switching
from ambient_trainer.diagnosis.gain import differ
from ambient_trainer.diagnosis.model import Effect
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Cause, Step
from ambient_trainer.diagnosis.selection import Selection, Trial
from ambient_trainer.diagnosis.words import digits

LONGEST_S = 4 * 3600.0
_MOST_RIVALS = 3
_LONGEST_PERIODS = 120.0
"""What is logged every quarter of an hour hardly moves within four hours."""
_CONSTANTS = 3.0
_SHORTEST_S = 600.0
_HEADROOM_K = 25.0
"""How far beyond its records a device may be taken."""


def next_experiment(selection: Selection, steps: tuple[Step, ...]) -> str:
    """What to switch, for how long, which sensor to read, and what each of several explanations predicts for it.

    The explanations are the cause of the last step that has rivals and the closest of those; without any, the cause of
    the first step and the next best; without a step, the best candidate and none. ``unknown`` asks for a survey.
    """
    if any(step.cause.name == UNKNOWN for step in steps):
        return _survey(selection)
    if not steps:
        return _to_rule_out(selection)
    taken = [(choice, choice.selected) for choice in selection.steps if choice.selected is not None]
    for choice, trial in reversed(taken):
        if rivals := _closest(trial, choice.rivals):
            return _apart(selection, trial, rivals[:_MOST_RIVALS])
    choice, trial = taken[0]
    return _apart(selection, trial, _closest(trial, choice.trials)[:1])


def _closest(taken: Trial, others: Sequence[Trial]) -> list[Trial]:
    """The best of each other cause, the best first."""
    ordered = sorted(others, key=lambda each: differ(each.blocks, taken.blocks))
    best: dict[Cause, Trial] = {}
    for each in ordered:
        best.setdefault(each.cause, each)
    return [each for cause, each in best.items() if cause != taken.cause]


def _to_rule_out(selection: Selection) -> str:
    trials = selection.steps[0].trials if selection.steps else ()
    if not trials:
        return "Nothing is missing, and no candidate is left to rule out."
    return f"To show or to rule out what comes closest, {trials[0].cause}: {_apart(selection, trials[0], [])}"


def _apart(selection: Selection, one: Trial, others: Sequence[Trial]) -> str:
    """``one`` from other trials of the same step; without any, from the model without any effect."""
    effects = [each.fitted.model.effects[-1] for each in (one, *others)]
    intervention, repeated = _intervention(effects)
    compared: Sequence[Trial | None] = others or [None]
    against = [_hypothesis(selection, each, repeated) for each in compared]
    signals = [each.candidate.cause.signal for each in effects if each.candidate.cause.signal is not None]
    bench = bench_of(selection.plain.views, signals)
    facts = _limits(selection)
    found = largest_difference(_hypothesis(selection, one, repeated), against, plans(bench, intervention), bench, facts)
    claims = (claim(one.cause), *(claim(Cause(NONE) if each is None else each.cause) for each in compared))
    words = Wording(claims, bench, one.fitted.model.plant.sensors, repeated[0] if repeated else None)
    return words.not_distinguished(found, facts.longest_s) if found.crossing_s is None else words.distinguished(found)


def _hypothesis(selection: Selection, trial: Trial | None, repeated: Sequence[Effect]) -> Hypothesis:
    if trial is None:
        return Hypothesis(selection.plain.model, None)
    model = trial.fitted.model
    return Hypothesis(model, model.effects[-1], any(each is model.effects[-1] for each in repeated))


def _intervention(effects: Sequence[Effect]) -> tuple[Intervention, list[Effect]]:
    """What can be done about what happened, and the effects that it would bring back."""
    # what begins or ends was done by somebody; a sensor fails by itself
    done = [each for each in effects if not each.sensors and (each.onset_s is not None or each.end_s is not None)]
    if done:
        return Intervention.UNDONE if any(each.end_s is None for each in done) else Intervention.REPEATED, done
    over = [each for each in effects if each.end_s is not None]
    return (Intervention.AWAITED, over) if over else (Intervention.LEFT, [])


def _limits(selection: Selection) -> Limits:
    records = [view.record for view in selection.plain.views]
    seen = np.concatenate([record.sensors.reshape(-1) for record in records])
    return Limits(
        since_s=min(float(record.time_s[0]) for record in records),
        now_s=max(float(record.time_s[-1]) for record in records),
        longest_s=max(LONGEST_S, _LONGEST_PERIODS * records[0].period_s),
        bounds_degC=(float(np.nanmin(seen)) - _HEADROOM_K, float(np.nanmax(seen)) + _HEADROOM_K),
        noise=selection.noise,
    )


def _survey(selection: Selection) -> str:
    """Rest, then every drive alone for three of the slowest time constants; the sensor to watch is the one most off."""
    views = selection.final.views
    plant = views[0].plant
    bench = bench_of(views, list(views[0].signals))
    left = np.concatenate([view.residual_degC for view in views], axis=1)
    off_degC = np.sqrt(np.nanmean(left**2, axis=1))
    worst = int(np.argmax(off_degC))
    slowest_s = _CONSTANTS / float(-plant.rates.max())
    each_s = 60.0 * math.ceil(min(max(slowest_s, _SHORTEST_S), LONGEST_S) / 60.0)
    steps = [switching(drive.column, drive.rest, drive.levels[0]) for drive in bench.drives if drive.levels]
    steps += [switching(name, level, level + 10.0) for name, level in bench.temperatures_degC.items()]
    return (
        f"{rest(bench)}. Then, one at a time and back again, for {span(each_s)} each, {listed(steps)}, and log what"
        f" else goes on at `{plant.sensors[worst]}`, where {digits(off_degC[worst], 2)} degC are unexplained: what"
        " is wrong at rest already is an instrument or an unlogged source, what comes with one switch goes with it."
    )
