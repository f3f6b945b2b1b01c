"""Without known-good runs, what a circuit lacks of a box is named; its parameters are searched for along with it."""

import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import NONE, Cause

LACKING = {
    "heat_source": Cause("heat_source", "shell", "radio_on"),
    "current_squared": Cause("heat_source", "board", "battery_current_A"),
    "convection_law": Cause("convection_law"),
    "thermal_mass": Cause("thermal_mass", "shell"),
    "path": Cause("path", "chip-shell"),
    "sensor_lag": Cause("sensor_lag", "chip"),
    "sensor_gain": Cause("sensor_gain", "board"),
    "clock_offset": Cause("clock_offset"),
}
SEEDS = (1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("lacks", list(LACKING))
def test_what_the_circuit_lacks_is_named(box, boxed, lacks, seed):
    said = diagnose(box, [boxed(lacks, seed)])
    assert said.verdict_cause == LACKING[lacks]
    assert said.verdict.gain.ci95_degC[0] > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_named_where_nothing_is_lacking(box, boxed, seed):
    assert diagnose(box, [boxed(NONE, seed)]).verdict_cause == Cause(NONE)


def test_a_current_heats_by_its_square(box, boxed):
    verdict = diagnose(box, [boxed("current_squared", 1)]).verdict
    assert verdict.magnitude.unit == "W/A^2"
    assert "squared" in verdict.magnitude.meaning
