"""Error codes and wild readings among a temperature's are set aside; what a temperature may do is not."""

import numpy as np
import pytest

from ambient_trainer.data.spikes import without_spikes
from ambient_trainer.data.trace import Trace

SAMPLES = 3000


def wandering(random: np.random.Generator) -> np.ndarray:
    """Between about 14 and 42 degC, with noise."""
    time = np.arange(SAMPLES)
    walk = np.cumsum(random.normal(0, 0.05, SAMPLES))
    walk -= np.linspace(0, walk[-1], SAMPLES)
    return 28 + 14 * np.sin(time / 300) + walk + random.normal(0, 0.05, SAMPLES)


@pytest.mark.parametrize("code", [85.0, -127.0, 0.0, 900.0])
def test_a_few_wild_readings_go_and_a_gap_stays(code):
    seed = int(np.random.default_rng().integers(1 << 30))
    random = np.random.default_rng(seed)
    true = wandering(random)
    at = 20 + 100 * np.arange(25) + random.integers(0, 50, 25)
    planted = np.concatenate([at, at[:5] + 1, at[:5] + 2])
    read = true.copy()
    read[planted], read[10] = code, np.nan
    found, count = without_spikes(Trace("log", np.arange(float(SAMPLES)), {"box_degC": read, "fan_rpm": true}))
    assert count == {"box_degC": len(planted)}, seed
    assert np.nanmax(np.abs(found.columns["box_degC"] - true)) < 1.0, seed
    assert np.isnan(found.columns["box_degC"][10])
    assert found.columns["fan_rpm"] is true


def test_of_other_columns_only_what_is_far_larger_than_all_else_goes():
    flow = np.where(np.arange(SAMPLES) % 500 < 60, 140.0, 0.0)
    rare = np.zeros(SAMPLES)
    rare[700:702] = 5.0
    columns = {"flow_Hz": flow.copy(), "inrush_A": 9.0 * flow, "door_on": rare}
    columns["flow_Hz"][1234] = 43_407.0
    found, count = without_spikes(Trace("log", np.arange(float(SAMPLES)), columns))
    assert count == {"flow_Hz": 1}
    assert np.array_equal(found.columns["flow_Hz"], flow)


@pytest.mark.parametrize("what", ["nothing", "a step", "bursts of load", "codes for a while", "codes at every tenth"])
def test_what_a_temperature_may_do_stays_and_what_is_more_than_a_few(what):
    seed = int(np.random.default_rng().integers(1 << 30))
    random = np.random.default_rng(seed)
    read = wandering(random)
    if what == "a step":
        read[1500:] += 30.0
    if what == "bursts of load":
        at = 20 + 150 * np.arange(19) + random.integers(0, 100, 19)
        read[at], read[at + 1] = read[at] + 16.0, read[at + 1] + 12.0
    if what == "codes for a while":
        read[700:720] = 85.0
    if what == "codes at every tenth":
        read[::10] = 85.0
    trace = Trace("log", np.arange(float(SAMPLES)), {"box_degC": read})
    assert without_spikes(trace) == (trace, {}), seed
