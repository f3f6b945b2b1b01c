"""Unit-to-unit variation: a model of one unit on others of the same make, as it is and with each unit's correction.

All units have the same weather and noise, so only they differ. Each is calibrated bare, on a run of its own; its
correction is then scored on the other runs, bare and in its case.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from joblib import delayed
from threadpoolctl import threadpool_limits

from ambient_model.model import Model
from ambient_studies.mitigation.loop import phone_zones
from ambient_studies.unit_variation.runs import CALIBRATION, ON_BEFORE_MIN, Asked, traces
from ambient_studies.unit_variation.unit import Unit, drawn, nominal
from ambient_trainer.data import Trace
from ambient_trainer.estimation import results, workers
from ambient_trainer.evaluation import correction, evaluate_trace
from ambient_trainer.simulator import load_scenario

Progress = Callable[[str, int, int], None]
"""Called with what is under way, how much of it is done, and of how much."""

_AT_ONCE = 5
"""Units that are simulated together."""
_CALIBRATIONS_APART = 1000


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


@dataclass(frozen=True)
class ScoredUnit:
    """A unit (0 is the nominal one), its correction, and its runs."""

    number: int
    offset_degC: float
    scores: tuple[Score, ...]


@dataclass(frozen=True)
class Study:
    """A model on all units, the nominal one first."""

    model: Model
    plan: Plan
    nominal: ScoredUnit
    units: tuple[ScoredUnit, ...]


def study(model: Model, plan: Plan, jobs: int, progress: Progress) -> Study:
    """Score a model on units drawn within the tolerances of manufacture.

    Parameters
    ----------
    model : Model
        Fitted to the nominal simulated phone.
    plan : Plan
        Units, scenarios, seed and sampling period.
    jobs : int
        Processes.
    progress : callable
        Called with what is under way, how much of it is done, and of how much.

    Returns
    -------
    Study
        Errors and correction of every unit.

    Raises
    ------
    Refused
        Where the simulated phone lacks one of the model's inputs.
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
        logged = traces(runs, plan.period_s)
        each = len(runs) // len(units)
        return [
            _one(model, unit.number, runs[first : first + each], logged[first : first + each])
            for unit, first in zip(units, range(0, len(runs), each))
        ]


def _runs(unit: Unit, plan: Plan) -> list[Asked]:
    calibration = Asked(unit, False, CALIBRATION, _CALIBRATIONS_APART * plan.seed + unit.number)
    return [
        calibration,
        *(Asked(unit, cased, name, plan.seed) for name in plan.scenarios for cased in (False, True)),
    ]


def _one(model: Model, number: int, runs: Sequence[Asked], logged: Sequence[Trace]) -> ScoredUnit:
    found = correction.correction(model, correction.known_between(logged[0], 60 * ON_BEFORE_MIN, None))
    improved = correction.corrected(model, found, {"trace": CALIBRATION})
    scores = [_score(run, model, improved, trace) for run, trace in zip(runs[1:], logged[1:])]
    return ScoredUnit(number, found.offsets_degC[correction.MAIN], tuple(scores))


def _score(run: Asked, model: Model, improved: Model, trace: Trace) -> Score:
    before, after = evaluate_trace(model, trace), evaluate_trace(improved, trace)
    return Score(
        run.scenario,
        run.cased,
        before.metrics.rmse_degC,
        before.metrics.mbe_degC,
        before.metrics.sigma_degC,
        100 * before.coverage[90],
        after.metrics.rmse_degC,
        after.metrics.mbe_degC,
        100 * after.coverage[90],
    )
