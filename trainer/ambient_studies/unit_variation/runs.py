"""Units go through scenarios, bare or in their cases, and learn their offsets from a week of a reading a day."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambient_model.tracking import Estimate
from ambient_model.unit_offset import LEARNING, OffsetPrior, estimate_variance_degC2, initial, predicted, updated
from ambient_trainer.data import Trace
from ambient_trainer.evaluation import Evaluation
from ambient_trainer.simulator import Progress, Scenario, Step, Unit, UnitRun, load_scenario, prepare, stream, traces_of

CALIBRATION = "calibration"
CALIBRATION_DEGC = 25.0
KNOWN_MIN, ON_BEFORE_MIN = 10.0, 30.0
"""How long the ambient is known, and how long the phone has been on by then."""
_SETTLED_MIN = 15.0


class Asked(NamedTuple):
    """A unit, whether in its case, what it is put through, and the seed of weather and noise."""

    unit: Unit
    cased: bool
    scenario: str
    """Of the shipped ones, or ``CALIBRATION``."""
    seed: int


def traces(runs: Sequence[Asked], period_s: float, progress: Progress | None = None) -> list[Trace]:
    """What each run logs, in the time of the longest."""
    prepared = [prepare(scenario_of(each.scenario), each.seed, period_s, each.unit.phone) for each in runs]
    return traces_of([UnitRun(*each, run) for each, run in zip(runs, prepared)], period_s, progress)


def scenario_of(name: str) -> Scenario:
    """The shipped scenario of that name, or the rest during which a unit is calibrated."""
    if name != CALIBRATION:
        return load_scenario(name)

    def resting(minutes: float) -> Step:
        return Step(duration_min=minutes, chamber_degC=CALIBRATION_DEGC)

    about = f"At rest at {CALIBRATION_DEGC:g} degC"
    return Scenario(about=about, before=(resting(_SETTLED_MIN),), steps=(resting(ON_BEFORE_MIN + KNOWN_MIN),))


DAYS = 7
READING_SIGMA_DEGC = 0.5
LIE_DEGC = 10.0
_DAY_S = 86400.0
_LEVEL_PERCENT = 90


def learnt(number: int, seed: int, days: Sequence[Evaluation], lie_degC: float = 0.0) -> list[float]:
    """The offset in degC after each day of a unit that rests, one run a day.

    A reading at a random moment of the last ten minutes is the ambient, a normal error of ``READING_SIGMA_DEGC``, and
    ``lie_degC``. It counts as on the device: in the same statuses, and within the gate.
    """
    random, prior = stream(seed, f"unit {number} readings"), OffsetPrior()
    state, offsets = initial(prior), []
    for day, run in enumerate(days):
        first = int(np.searchsorted(run.time_s, 60 * ON_BEFORE_MIN))
        at = int(random.integers(first, len(run.time_s)))
        reading_degC = run.reference_degC[at] + random.normal(0.0, READING_SIGMA_DEGC) + lie_degC
        state = predicted(prior, state, day * _DAY_S)
        if run.status[at] in LEARNING:
            y, low, high = (float(each[at]) for each in (run.estimate_degC, run.low_degC, run.high_degC))
            estimate = Estimate(y, low, high, str(run.status[at]), ())
            R = READING_SIGMA_DEGC**2 + estimate_variance_degC2(estimate, _LEVEL_PERCENT)
            state = updated(prior, state, reading_degC - y, R) or state
        offsets.append(state.offset_degC)
    return offsets
