"""Without known-good runs, what a circuit lacks of a box is named; its parameters are fitted along with it."""

import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import NONE, Cause

LACKING = {
    "heat_source": Cause("heat_source", "shell", "radio_on"),
    "current_squared": Cause("heat_source", "board", "battery_current_A^2"),
    "convection_law": Cause("convection_law", "shell"),
    "thermal_mass": Cause("thermal_mass", "shell"),
    "path": Cause("path", "chip-shell"),
    "sensor_lag": Cause("sensor_lag", "chip"),
    "sensor_gain": Cause("sensor_gain", "board"),
    "clock_offset": Cause("clock_offset"),
    NONE: Cause(NONE),
}
COARSE_S = 60.0
QUICK = ("heat_source", NONE)
"""Diagnosed on a coarse grid in the quick run; the slow run takes every sample of another box."""
SLOW = [pytest.param(lacks, 2, None, marks=pytest.mark.slow) for lacks in LACKING]


@pytest.mark.parametrize(("lacks", "seed", "period_s"), [*((lacks, 1, COARSE_S) for lacks in QUICK), *SLOW])
def test_what_the_circuit_lacks_is_named(box, boxed, lacks, seed, period_s):
    found = diagnose(box, [boxed(lacks, seed)], period_s=period_s)
    assert found.verdict_cause == LACKING[lacks]
    if lacks != NONE:
        assert found.verdict.gain.ci95_degC[0] > 0
    if lacks == "current_squared":
        assert found.verdict.magnitude.unit == "W/A^2"
