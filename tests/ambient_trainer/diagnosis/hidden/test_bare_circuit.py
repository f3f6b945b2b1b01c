"""What a circuit lacks of a box is named, without known-good runs and beside them."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import Prior, fit
from ambient_trainer.diagnosis.record import records_of
from ambient_trainer.diagnosis.result import NONE, Cause

from ...conftest import in_air

LACKING = {
    "heat_source": Cause("heat_source", "shell", "radio_on"),
    "current_squared": Cause("heat_source", "board", "battery_current_A^2"),
    "convection_law": Cause("convection_law", "shell"),
    "thermal_mass": Cause("thermal_mass", "shell"),
    "path": Cause("path", "chip-shell"),
    "sensor_lag": Cause("sensor_lag", "chip"),
    "sensor_gain": Cause("sensor_gain", "board"),
    "clock_offset": Cause("clock_offset"),
    "reference_lag": Cause("sensor_lag", "ambient"),
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


def test_a_prior_from_records_is_their_least_squares(box, boxed):
    """A fit to one record under the prior of another, where both leave the same, is that to both together."""
    one, other = (records_of(box, boxed("none", seed), COARSE_S) for seed in (1, 2))
    model = GreyBox.of(box)
    first = fit(model, one, tolerance=1e-9)
    together = fit(model, [*one, *other], tolerance=1e-9)
    after = fit(first.model, other, prior=Prior.trained(first), tolerance=1e-9)
    scatter = np.sqrt(np.diag(together.covariance))
    assert (np.abs(after.model.z() - together.model.z()) < 2 * scatter + 0.01).all()


def test_what_changed_is_not_taken_up_by_what_is_known(box, boxed):
    """The lid is closed: beside a known-good run the loss has changed, and nothing else."""
    found = diagnose(box, [boxed("ambient_coupling", 1)], [boxed("none", 101)], period_s=COARSE_S)
    assert (found.verdict_cause.name, found.verdict_cause.location) == ("ambient_coupling", "shell")
    assert found.verdict.magnitude.value == pytest.approx(0.25 / 0.15 - 1, rel=0.1)
    assert found.verdict.magnitude.ci95[0] > 0


@pytest.mark.slow
@pytest.mark.parametrize(("cause", "wrong"), [("sensor_gain", lambda read: 1.25 * read - 6.25), ("sensor_stuck", 31.3)])
@pytest.mark.parametrize("seed", [2, 3])
def test_a_sensor_that_is_wrong_for_a_while(box, boxed, cause, wrong, seed):
    trace = boxed(NONE, seed)
    on_s, off_s = np.random.default_rng(seed).uniform([0.2, 0.5], [0.4, 0.8]) * trace.time_s[-1]
    read, off = trace.columns["board_degC"], (trace.time_s > on_s) & (trace.time_s < off_s)
    columns = {**trace.columns, "board_degC": np.where(off, wrong(read) if callable(wrong) else wrong, read)}
    found = diagnose(box, [replace(trace, columns=columns)], [boxed(NONE, 100 + seed)], period_s=COARSE_S)
    assert found.verdict_cause == Cause(cause, "board")
    assert (found.verdict.onset_s, found.verdict.end_s) == pytest.approx((on_s, off_s), abs=COARSE_S)


SAMPLES, AIR_DEGC, DRAWS = 1400, 22.0, 4


def heated(random: np.random.Generator) -> tuple[Trace, float, float]:
    """A wire, a block that loses more than in proportion, a slow sensor and a controller; when the fan goes on, and
    what the resistance is then."""
    time_s = np.arange(SAMPLES, dtype=float)
    on_s, factor = random.uniform(0.25, 0.7) * SAMPLES, random.uniform(1.3, 1.8)
    hot, warm = random.uniform(150, 210), random.uniform(90, 130)
    target_degC = np.where(time_s < 60, 0.0, np.where(time_s < random.uniform(500, 800), hot, warm))
    wire = block = sensor = AIR_DEGC
    power_W, read_degC, integral, steps = np.zeros(SAMPLES), np.zeros(SAMPLES), 0.0, 5
    for row in range(SAMPLES):
        read_degC[row] = sensor + random.normal(0.0, 0.1)
        error_K = target_degC[row] - sensor
        integral = float(np.clip(integral + 0.02 * error_K, 0.0, 25.0))
        power_W[row] = np.clip(1.2 * error_K + integral, 0.0, 40.0)
        for _ in range(steps):
            loss = 0.11 * (1 + 0.0012 * (block - AIR_DEGC)) * (factor if row > on_s else 1.0)
            across = 0.9 * (wire - block)
            wire += (power_W[row] - across) / 4.0 / steps
            block += (across - loss * (block - AIR_DEGC)) / 14.0 / steps
            sensor += (block - sensor) / 6.0 / steps
    columns = {"block_degC": read_degC, "ambient_degC": np.full(SAMPLES, AIR_DEGC), "heater_W": power_W}
    return Trace("heater.csv", time_s, columns), on_s, 1 / factor - 1


@pytest.mark.slow
def test_a_fan_that_goes_on_is_named_once_and_nothing_else_is_sure():
    circuit, named = in_air("block", 20, 5), 0
    for draw in range(DRAWS):
        trace, on_s, less = heated(np.random.default_rng([8, draw]))
        steps = diagnose(circuit, [trace]).steps
        assert steps[0].cause.name == "heat_source"
        assert "heater_W" in steps[0].cause.signal
        unlogged = [each for each in steps if each.cause.signal is None]
        assert all(each.cause.name == "ambient_coupling" for each in unlogged if each.confidence >= 0.9)
        first = unlogged[0]
        if first.cause.name == "ambient_coupling":
            assert (first.onset_s, first.end_s) == (pytest.approx(on_s, abs=60.0), None)
            assert first.magnitude.value == pytest.approx(less, abs=0.12)
            named += 1
    assert named >= DRAWS / 2
