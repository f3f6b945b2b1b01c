"""A fan that nobody logs goes on while a controller holds a heater at its set point: the loss has changed, once."""

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose

from ...conftest import in_air

pytestmark = pytest.mark.slow

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


def test_it_is_named_once_and_nothing_else_is_sure():
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
