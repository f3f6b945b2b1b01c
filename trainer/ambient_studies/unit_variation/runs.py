"""Units go through scenarios, bare or in their cases, all together in one loop over arrays."""

from collections.abc import Sequence
from typing import NamedTuple

from ambient_trainer.data import Trace
from ambient_trainer.simulator import (
    Added,
    Instruments,
    Progress,
    Scenario,
    Step,
    Unit,
    case_of,
    integrate,
    load_scenario,
    prepare,
    trace_of,
)

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
    covered = [
        case_of(each.unit, run, period_s, each.seed) if each.cased else Added() for each, run in zip(runs, prepared)
    ]
    driven = integrate(prepared, period_s, progress, covered)
    return [
        trace_of(one, each.scenario, each.seed, period_s, each.unit.zones, Instruments(each.unit.gains))
        for one, each in zip(driven, runs)
    ]


def scenario_of(name: str) -> Scenario:
    """The shipped scenario of that name, or the rest during which a unit is calibrated."""
    if name != CALIBRATION:
        return load_scenario(name)

    def resting(minutes: float) -> Step:
        return Step(duration_min=minutes, chamber_degC=CALIBRATION_DEGC)

    about = f"At rest at {CALIBRATION_DEGC:g} degC"
    return Scenario(about=about, before=(resting(_SETTLED_MIN),), steps=(resting(ON_BEFORE_MIN + KNOWN_MIN),))
