"""Unit-to-unit variation: a model of one unit on others of the same make, as it is and with each unit's correction.

All units have the same weather and noise, so only they differ. Each is calibrated bare, on a run of its own; its
correction is then scored on the other runs, bare and in its case. So is the offset that it learns from a week of
readings.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import NamedTuple

import numpy as np
from joblib import delayed
from threadpoolctl import threadpool_limits

from ambient_model import unit_offset
from ambient_model.model import Model
from ambient_model.observer import Observer
from ambient_model.tracking import Estimate, Tracker, nearest_discrete
from ambient_model.validation import Validation
from ambient_studies import Progress
from ambient_studies.mitigation.loop import phone_zones
from ambient_trainer.data import Trace, sampling_period_s
from ambient_trainer.estimation import results, workers
from ambient_trainer.evaluation import correction, evaluate_trace
from ambient_trainer.simulator import (
    Planned,
    Scenario,
    ScenarioStep,
    Unit,
    drawn,
    load_scenario,
    logged,
    nominal,
    stream,
    unit_run,
)

CALIBRATION = "calibration"
CALIBRATION_DEGC = 25.0
KNOWN_MIN, ON_BEFORE_MIN = 10.0, 30.0
"""How long the ambient is known, and how long the phone has been on by then."""
_SETTLED, _REST = (
    ScenarioStep(duration_min=minutes, chamber_degC=CALIBRATION_DEGC) for minutes in (15.0, ON_BEFORE_MIN + KNOWN_MIN)
)
_RESTING = Scenario(about=f"At rest at {CALIBRATION_DEGC:g} degC", before=(_SETTLED,), steps=(_REST,))


def run_of(unit: Unit, cased: bool, scenario: str, seed: int, period_s: float) -> Planned:
    """A unit in a shipped scenario, or at the rest during which it is calibrated; ``seed`` is of weather and noise."""
    asked = _RESTING if scenario == CALIBRATION else load_scenario(scenario)
    return unit_run(unit, cased, (scenario, seed), asked, period_s)


DAYS = 7
READING_SIGMA_DEGC = 0.5
LIE_DEGC = 10.0
_DAY_S = 86400.0
_LEVEL_PERCENT = 90


class Offsets(NamedTuple):
    """What a unit has learnt: the offset of its estimate, and of each sensor where the model determines them."""

    offset_degC: float
    sensors_degC: tuple[float, ...]


def offsets_by_day(model: Model, number: int, seed: int, days: Sequence[Trace], lie_degC: float = 0.0) -> list[Offsets]:
    """What a unit that rests has learnt after each day, one run a day.

    A reading at a random moment of the last ten minutes is the ambient, a normal error of ``READING_SIGMA_DEGC``, and
    ``lie_degC``. It counts as on the device: in the same statuses, and within the gate.
    """
    random, prior = stream(seed, f"unit {number} readings"), unit_offset.OffsetPrior()
    gains = model.readings.offset_gains if model.readings else ()
    if model.readings and gains:
        prior = unit_offset.learning_sensors(prior, model.readings)
    state, sensors = unit_offset.initial(prior), unit_offset.SensorOffsets((0.0,) * len(model.main.inputs))
    found = []
    for day, trace in enumerate(days):
        first = int(np.searchsorted(trace.time_s, 60 * ON_BEFORE_MIN))
        at = int(random.integers(first, len(trace.time_s)))
        reading_degC = trace.reference[at] + random.normal(0.0, READING_SIGMA_DEGC) + lie_degC
        state = unit_offset.predicted(prior, state, day * _DAY_S)
        estimate, validation = _at(model, _without(model, trace, sensors.degC), at)
        if estimate.status in unit_offset.LEARNING and estimate.ambient_degC is not None:
            seen, y = sensors, reading_degC - estimate.ambient_degC
            if gains and validation and (slow_degC := validation.slow_differences(sensors.degC)):
                seen = unit_offset.sensors_updated(prior, sensors, gains, slow_degC)
                y += float(np.dot(validation.gains, np.subtract(seen.degC, sensors.degC)))
            variance_degC2 = unit_offset.estimate_variance_degC2(estimate, _LEVEL_PERCENT, prior.std_degC**2)
            after = unit_offset.updated(prior, state, y, READING_SIGMA_DEGC**2 + variance_degC2)
            state, sensors = (state, sensors) if after is None else (after, seen)
        found.append(Offsets(state.offset_degC, sensors.degC))
    return found


def _at(model: Model, trace: Trace, sample: int) -> tuple[Estimate, Validation | None]:
    """The estimate at that sample, and the validation as it is then."""
    discrete = nearest_discrete(model.main, sampling_period_s(trace.time_s))
    observer = Observer(model, Tracker(model.main, discrete, _LEVEL_PERCENT), _LEVEL_PERCENT)
    readings = np.column_stack([trace.columns[each.column] for each in model.main.inputs])[: sample + 1]
    for time_s, row in zip(trace.time_s.tolist(), readings.tolist()):
        estimate = observer.update(time_s, row)
    return estimate, observer.validation


def _without(model: Model, trace: Trace, offsets_degC: Sequence[float]) -> Trace:
    """The trace without the sensors' own errors."""
    moved = {each.column: trace.columns[each.column] - offset for each, offset in zip(model.main.inputs, offsets_degC)}
    return replace(trace, columns={**trace.columns, **moved})


_AT_ONCE = 5
"""Units that are simulated together."""
_CALIBRATIONS_APART = 1000
_DAYS_APART = 1_000_000


@dataclass(frozen=True)
class Plan:
    """Which units, drawn from ``seed``, go through which scenarios; ``seed`` is that of the weather, too."""

    count: int
    seed: int
    scenarios: tuple[str, ...]
    period_s: float


@dataclass(frozen=True)
class Score:
    """A unit's run: how wrong the model is, as it is and with the unit's correction, in degC."""

    scenario: str
    cased: bool
    rmse_degC: float
    bias_degC: float
    """The mean error, true minus estimate."""
    scatter_degC: float
    """The RMSE that the best constant would leave, known afterwards."""
    inside90_percent: float
    """Of the errors, in the interval that the model publishes."""
    corrected_rmse_degC: float
    corrected_bias_degC: float
    corrected_inside90_percent: float
    learnt_rmse_degC: float
    learnt_bias_degC: float
    learnt_inside90_percent: float


@dataclass(frozen=True)
class ScoredUnit:
    """A unit (0 is the nominal one), its correction, and its runs."""

    number: int
    offset_degC: float
    scores: tuple[Score, ...]
    learnt_offset_degC: float
    """Learnt in a week of one reading a day."""
    liar_moves_degC: float
    """The furthest that readings which are all too high move it."""


@dataclass(frozen=True)
class Study:
    """A model on all units, the nominal one first."""

    model: Model
    plan: Plan
    nominal: ScoredUnit
    units: tuple[ScoredUnit, ...]


def study(model: Model, plan: Plan, jobs: int, progress: Progress) -> Study:
    """Score a model, fitted to the nominal simulated phone, on units drawn within the tolerances of manufacture.

    Raises :class:`Refused` where the phone lacks one of the model's inputs.
    """
    for name in plan.scenarios:
        load_scenario(name)
    zones = phone_zones(model, model.main.inputs[0].name)
    units = [nominal(zones), *(drawn(number, plan.seed, zones) for number in range(1, plan.count + 1))]
    parts = [units[first : first + _AT_ONCE] for first in range(0, len(units), _AT_ONCE)]
    what = f"{len(units)} phones"
    found: list[ScoredUnit] = []
    progress(what, 0, len(units))
    with workers(min(jobs, len(parts))) as parallel:
        for scored in results(parallel, (delayed(_scored)(model, part, plan) for part in parts)):
            found += scored
            progress(what, len(found), len(units))
    return Study(model, plan, found[0], tuple(found[1:]))


def _scored(model: Model, units: Sequence[Unit], plan: Plan) -> list[ScoredUnit]:
    with threadpool_limits(1):
        runs = [run for unit in units for run in _runs(unit, plan)]
        traces = iter([each.trace for each in logged(runs, plan.period_s)])
        return [_one(model, unit.number, plan, list(islice(traces, len(runs) // len(units)))) for unit in units]


def _runs(unit: Unit, plan: Plan) -> list[Planned]:
    """A unit's calibration, its days of readings, and the runs that are scored."""
    seed = _CALIBRATIONS_APART * plan.seed + unit.number
    asked = [(False, CALIBRATION, seed + _DAYS_APART * day) for day in range(DAYS + 1)]
    asked += [(cased, name, plan.seed) for name, cased in product(plan.scenarios, (False, True))]
    return [run_of(unit, *each, plan.period_s) for each in asked]


def _one(model: Model, number: int, plan: Plan, traces: Sequence[Trace]) -> ScoredUnit:
    calibration, days, scored = traces[0], traces[1 : DAYS + 1], traces[DAYS + 1 :]
    found = correction.correction(model, calibration, 60 * ON_BEFORE_MIN)
    improved = correction.corrected(model, found, {"trace": CALIBRATION})
    week = offsets_by_day(model, number, plan.seed, days)[-1]
    lied_degC = max(abs(each.offset_degC) for each in offsets_by_day(model, number, plan.seed, days, LIE_DEGC))
    groups = product(plan.scenarios, (False, True))
    scores = [_score(*group, model, improved, trace, week) for group, trace in zip(groups, scored)]
    return ScoredUnit(number, found.offsets_degC[correction.MAIN], tuple(scores), week.offset_degC, lied_degC)


def _score(scenario: str, cased: bool, model: Model, improved: Model, trace: Trace, week: Offsets) -> Score:
    before, after = evaluate_trace(model, trace), evaluate_trace(improved, trace)
    learning = evaluate_trace(model, _without(model, trace, week.sensors_degC))
    metrics, known = learning.metrics, np.isfinite(learning.error_degC)
    bias_degC = metrics.mbe_degC - week.offset_degC
    # in the published interval, once it is moved by the offset
    moved_degC = learning.reference_degC[known] - week.offset_degC
    inside = (learning.low_degC[known] <= moved_degC) & (moved_degC <= learning.high_degC[known])
    as_it_is = before.metrics.rmse_degC, before.metrics.mbe_degC, before.metrics.sigma_degC, 100 * before.coverage[90]
    corrected = after.metrics.rmse_degC, after.metrics.mbe_degC, 100 * after.coverage[90]
    rmse_degC = math.sqrt(metrics.rmse_degC**2 - metrics.mbe_degC**2 + bias_degC**2)
    by_week = rmse_degC, bias_degC, 100 * float(np.mean(inside))
    return Score(scenario, cased, *as_it_is, *corrected, *by_week)
