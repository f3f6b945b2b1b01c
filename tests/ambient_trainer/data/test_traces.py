"""A DataFrame is a trace as a file is; steps are recognised and imposed; wild readings are set aside."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.data.resolution import resolution_of, with_resolution
from ambient_trainer.data.spikes import without_spikes
from ambient_trainer.data.trace import Trace, load_trace
from refusals import refused

TRACE = Trace("a.csv", np.array([0.0, 1.5, 3.0]), {"usb_degC": np.array([20.0, np.nan, 21.0])}, {"room": "office"})


@pytest.mark.parametrize(
    "frame",
    [
        TRACE.to_frame(),
        TRACE.to_frame().reset_index(),
        TRACE.to_frame().set_axis(pd.to_timedelta(TRACE.time_s, "s")),
        TRACE.to_frame().set_axis(pd.to_datetime(TRACE.time_s, unit="s", utc=True)),
        TRACE.to_frame().astype("Float64"),
    ],
)
def test_a_frame_is_the_trace_it_came_from(frame):
    found = load_trace(frame)
    assert found.time_s.tolist() == TRACE.time_s.tolist()
    np.testing.assert_array_equal(found.columns["usb_degC"], TRACE.columns["usb_degC"])
    assert (list(found.columns), found.notes) == (["usb_degC"], TRACE.notes)


@pytest.mark.parametrize(
    ("columns", "index", "named"),
    [
        ({"usb": [1.0, 2.0]}, [0, 1], ["'usb'", "usb_degC"]),
        ({"usb_degC": [1.0, 2.0]}, [1, 1], ["row 1", "time_s"]),
        ({"usb_degC": [1.0, 2.0]}, [0.0, np.nan], ["row 1", "time_s"]),
        ({"usb_degC": [1.0, np.inf]}, [0, 1], ["row 1", "usb_degC"]),
        ({"usb_degC": [1.0, 1e37]}, [0, 1], ["row 1", "1e+37"]),
        ({"usb_degC": ["warm", "cold"]}, [0, 1], ["usb_degC", "warm"]),
        ({"usb_degC": []}, [], ["no rows"]),
    ],
)
def test_what_is_no_trace_is_refused_by_place(columns, index, named):
    said = str(refused(load_trace, pd.DataFrame(columns, index=index)))
    assert all(each in said for each in ["DataFrame", *named])


@given(st.sampled_from([1.0, 0.5, 0.25, 0.125, 0.1, 0.0625, 0.05, 0.01]), st.integers(0, 1000))
def test_a_step_is_recognised(step, seed):
    values = step * np.round(np.random.default_rng(seed).uniform(-40, 90, 300) / step)
    values[::7] = np.nan
    assert resolution_of(values) == step


def test_what_has_no_step_has_none_and_a_trace_is_coarse_where_asked_half_way_between_rounded_and_truncated():
    assert resolution_of(np.random.default_rng(1).uniform(-40, 90, 300)) == 0.0
    a = np.array([1.0, 1.2, 1.3, 1.4, -1.3, -1.4, np.nan])
    trace = Trace("t", np.arange(7.0), {"a_degC": a, "b_degC": a + 1})
    coarse = with_resolution(trace, {"a_degC": 0.5})
    assert coarse.columns["a_degC"][:6].tolist() == [1.0, 1.0, 1.0, 1.5, -1.0, -1.5]
    assert np.isnan(coarse.columns["a_degC"][6])
    assert coarse.columns["b_degC"] is trace.columns["b_degC"]


SAMPLES = 3000


def wandering(random: np.random.Generator) -> np.ndarray:
    """Between about 14 and 42 degC, with noise."""
    time = np.arange(SAMPLES)
    walk = np.cumsum(random.normal(0, 0.05, SAMPLES))
    walk -= np.linspace(0, walk[-1], SAMPLES)
    return 28 + 14 * np.sin(time / 300) + walk + random.normal(0, 0.05, SAMPLES)


@pytest.mark.parametrize("code", [85.0, -127.0, 0.0, 900.0])
def test_a_few_wild_readings_go_and_a_gap_stays(code, seed):
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
def test_what_a_temperature_may_do_stays_and_what_is_more_than_a_few(what, seed):
    random = np.random.default_rng(seed)
    read = wandering(random)
    if what == "a step":
        read[1500:] += 30.0
    if what == "bursts of load":
        at = 20 + 150 * np.arange(19) + random.integers(0, 100, 19)
        read[at], read[at + 1] = read[at] + 16.0, read[at + 1] + 12.0
    codes = {"codes for a while": slice(700, 720), "codes at every tenth": slice(0, None, 10)}
    read[codes.get(what, slice(0))] = 85.0
    trace = Trace("log", np.arange(float(SAMPLES)), {"box_degC": read})
    assert without_spikes(trace) == (trace, {}), seed
