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
SEEDS = (1, 2, 3)
QUICK = ("heat_source", "convection_law", NONE)
"""What the quick run looks for, with the first seed: each case takes about 20 seconds."""


def cases(*known_good_model: str) -> list[object]:
    """Each with all seeds, marked slow but for the quick ones."""
    return [
        pytest.param(lacks, seed, marks=[] if seed == 1 and lacks in QUICK else pytest.mark.slow)
        for lacks in known_good_model
        for seed in SEEDS
    ]


@pytest.mark.parametrize(("lacks", "seed"), cases(*LACKING))
def test_what_the_circuit_lacks_is_named(box, boxed, lacks, seed):
    said = diagnose(box, [boxed(lacks, seed)])
    assert said.verdict_cause == LACKING[lacks]
    assert said.verdict.gain.ci95_degC[0] > 0


@pytest.mark.parametrize(("lacks", "seed"), cases(NONE))
def test_nothing_is_named_where_nothing_is_lacking(box, boxed, lacks, seed):
    assert diagnose(box, [boxed(lacks, seed)]).verdict_cause == Cause(lacks)


def test_a_current_heats_by_its_square(box, boxed):
    verdict = diagnose(box, [boxed("current_squared", 1)]).verdict
    assert verdict.magnitude.unit == "W/A^2"
    assert "squared" in verdict.magnitude.meaning
