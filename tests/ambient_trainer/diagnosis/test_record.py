"""A record is a trace on a grid of means: nothing is lost to a linear circuit, and gaps stay gaps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import simulate
from ambient_trainer.diagnosis.record import (
    MOST_SAMPLES,
    MOST_STEPS,
    diagnosis_period_s,
    finely_simulated,
    means,
    records,
    straight,
)
from refusals import refused

from ..conftest import in_air


def _trace(time_s: np.ndarray, **columns: np.ndarray) -> Trace:
    return Trace("made.csv", time_s, columns)


def test_a_mean_is_that_of_what_lies_in_the_period():
    time_s = np.arange(40.0)
    values = np.random.default_rng(1).normal(20, 3, 40)
    values[[3, 12, *range(20, 30)]] = np.nan
    mean = means(_trace(time_s, a_degC=values), 10.0)
    np.testing.assert_allclose(mean.time_s, [5, 15, 25, 35])
    wanted = [np.nanmean(values[:10]), np.nanmean(values[10:20]), np.nan, np.nanmean(values[30:])]
    np.testing.assert_allclose(mean.columns["a_degC"], wanted)


def test_a_trace_about_as_coarse_is_left_alone():
    trace = _trace(10.0 * np.arange(20), a_degC=np.arange(20.0))
    assert means(trace, 15.0) is trace
    assert means(trace, 20.0) is not trace


def test_a_stretch_in_which_no_sensor_is_read_is_none():
    rows = np.arange(1500.0)
    read, air = rows.copy(), rows.copy()
    read[:900], air[500:1000] = np.nan, np.nan
    held = records(_trace(rows, a_degC=read, ambient_degC=air), ["ambient_degC"], ["a_degC"], 1.0)
    assert [each.time_s[0] for each in held] == [1000.0]


def _simulated(inputs: np.ndarray, period_s: float, held: bool = False, start: np.ndarray | None = None) -> np.ndarray:
    """A chip on a board in the air, (2, N), under the air and a heater's watts; from rest without a ``start``."""
    A = np.array([[-1 / 160, 1 / 160], [1 / 600, -1 / 600 - 1 / 2250]])
    B = np.array([[0, 1 / 20], [1 / 2250, 0]])
    start = np.linalg.solve(A, -B @ inputs[:, 0]) if start is None else start
    time_s = period_s * np.arange(inputs.shape[1])
    return lsim((A, B, np.eye(2), np.zeros((2, 2))), inputs.T, time_s, start, interp=not held)[1].T


def _left(record, period_s: float) -> np.ndarray:
    """What a record leaves of its own simulation, (2, N), from the start that leaves least."""
    left = record.sensors - _simulated(record.inputs, period_s, start=np.zeros(2))
    decays = np.array([_simulated(0 * record.inputs, period_s, start=one) for one in np.eye(2)])
    start = np.linalg.lstsq(decays.reshape(2, -1).T, left.ravel(), rcond=None)[0]
    return left - np.einsum("i,isk->sk", start, decays)


INPUTS, SENSORS = ("ambient_degC", "heater_W"), ["chip_degC", "board_degC"]


def test_averaging_commutes_with_a_linear_circuit():
    """The record of a finely simulated run is what the coarse circuit simulates from the record's inputs."""
    factor, samples = 10, 12000
    time_s = np.arange(float(samples))
    bursts = 3.0 * (np.random.default_rng(4).random(samples) < 0.1)  # shorter than the record's period
    inputs = np.stack([20 + 3 * np.sin(time_s / 900), bursts])
    nodes = _simulated(inputs, 1.0)
    trace = _trace(time_s, **dict(zip(INPUTS, inputs)), **dict(zip(SENSORS, nodes)))
    (record,) = records(trace, INPUTS, SENSORS, 10.0)
    assert record.samples == samples // factor
    np.testing.assert_allclose(record.inputs[1], bursts.reshape(-1, factor).mean(axis=1))
    averaged = _left(record, 10.0)
    taken = nodes[:, ::factor] - _simulated(inputs[:, ::factor], 10.0)
    # the chip feels where in its period a burst lay, the board hardly; sampling loses most bursts altogether
    averaged, taken = (np.sqrt(np.mean(each[:, 1:] ** 2, axis=1)) for each in (averaged, taken))
    assert (averaged < [0.15, 0.02]).all()
    assert (taken > 10 * averaged).all()


def test_what_is_simulated_follows_an_air_that_jumps():
    """From a cold zone to a hot one between two samples, as in a thermal-shock chamber: straight lines are off."""
    time_s = 5.0 * np.arange(8000)
    air = np.where((time_s / 1717).astype(int) % 2, 80.0, -30.0)
    A, B = np.array([[-1 / 40]]), np.array([[1 / 40]])
    plate = lsim((A, B, np.eye(1), np.zeros((1, 1))), air, time_s, [air[0]])[1]
    circuit = forward(in_air("plate", 100, 0.4))
    (record,) = finely_simulated(circuit, _trace(time_s, ambient_degC=air, plate_degC=plate), 50.0)
    assert (record.samples, record.every) == (800, 10)
    model, start = GreyBox.of(circuit), np.array([[air[0]]])
    left = record.sensors - simulate(model, record, model.z()[None], start)[0]
    coarse = record.sensors - simulate(model, replace(record, fine=None), model.z()[None], start)[0]
    assert np.abs(left).max() < 1e-8
    assert np.sqrt(np.mean(coarse**2)) > 1.0


def test_a_long_log_is_simulated_in_few_enough_steps():
    time_s = np.arange(86_400.0)
    trace = _trace(time_s, ambient_degC=time_s, chip_degC=time_s)
    (record,) = finely_simulated(forward(in_air("chip", 100, 1)), trace, 50.0)
    assert (record.samples, record.every, record.simulated.period_s) == (1728, 5, 10.0)
    np.testing.assert_allclose(np.diff(record.sensors[0]), 50.0)
    assert record.simulated.samples <= MOST_STEPS


def test_gaps_make_records_and_missing_readings_stay_missing():
    time_s = np.concatenate([10.0 * np.arange(50), 5000 + 10.0 * np.arange(60)])
    air = np.full(110, 20.0)
    chip = np.linspace(30, 40, 110)
    chip[[5, 70]] = np.nan
    on = np.ones(110)
    on[20:23] = np.nan
    trace = _trace(time_s, ambient_degC=air, chip_degC=chip, camera_on=on)
    one, two = records(trace, ["ambient_degC"], ["chip_degC"], 10.0)
    assert (one.samples, two.samples) == (50, 60)
    assert one.time_s[0] == 0
    assert two.time_s[0] == 5000
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(one.sensors[0])), [5])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(two.sensors[0])), [20])
    np.testing.assert_array_equal(one.signals["camera_on"], np.ones(50))
    assert set(one.signals) == {"ambient_degC", "camera_on"}


def test_a_missing_input_is_bridged_a_missing_signal_was_off_and_an_empty_input_is_refused():
    time_s = 10.0 * np.arange(100)
    air = 20 + 0.1 * np.arange(100)
    holed = air.copy()
    holed[40] = np.nan
    (record,) = records(_trace(time_s, ambient_degC=holed, chip_degC=air), ["ambient_degC"], ["chip_degC"], 10.0)
    np.testing.assert_allclose(record.inputs[0], air)
    empty = np.full(100, np.nan)
    trace = _trace(time_s, ambient_degC=air, chip_degC=air, camera_on=empty)
    (record,) = records(trace, ["ambient_degC"], ["chip_degC"], 10.0)
    np.testing.assert_array_equal(record.signals["camera_on"], np.zeros(100))
    trace = _trace(time_s, ambient_degC=empty, chip_degC=air)
    said = "no 3 samples in a row, one every 10 s, hold them all"
    assert said in str(refused(records, trace, ["ambient_degC"], ["chip_degC"], 10.0))


@pytest.mark.parametrize(("samples", "wanted"), [(100, 1.0), (1990, 1.0), (3900, 2.0), (9900, 5.0), (86400, 50.0)])
def test_the_finest_nice_period(samples, wanted):
    trace = _trace(np.arange(float(samples)), a_degC=np.zeros(samples))
    assert diagnosis_period_s([trace]) == wanted
    assert samples / wanted <= MOST_SAMPLES


def test_a_gap_of_a_day_costs_nothing_and_the_slowest_trace_sets_the_period():
    time_s = np.concatenate([np.arange(900.0), 86400 + np.arange(900.0)])
    assert diagnosis_period_s([_trace(time_s, a_degC=time_s)]) == 1.0
    fast, slow = np.arange(500.0), 10 * np.arange(500.0)
    assert diagnosis_period_s([_trace(fast, a_degC=fast), _trace(slow, a_degC=slow)]) == 10.0


@pytest.mark.parametrize("period_s", [20.0, 100.0])
def test_inputs_that_are_held_act_half_a_sample_later(period_s):
    """Kirchhoff's law under steps is told by a record of held inputs, and badly by one of straight lines."""
    count, own = 2000, 20.0
    draw = np.random.default_rng(3)
    time_s = own * np.arange(count // 4)
    air = 20.0 + 4.0 * np.sin(time_s / 1500.0) + 0.3 * np.cos(time_s / 130.0)
    inputs = np.repeat([air, np.repeat(draw.uniform(0.0, 2.5, count // 4 // 40 + 1), 40)[: count // 4]], 4, axis=1)
    nodes = _simulated(inputs, own, held=True)
    trace = _trace(own * np.arange(count), **dict(zip(INPUTS, inputs)), **dict(zip(SENSORS, nodes)))
    off = {}
    for hold in ("zero-order", "first-order"):
        (record,) = records(trace, INPUTS, SENSORS, period_s, hold)
        left = _left(record, period_s)[:, record.samples // 4 :]
        off[hold] = np.sqrt(np.mean(left**2, axis=1))
    assert (off["zero-order"] < 0.4 * off["first-order"]).all()


def test_a_held_value_after_a_gap_stands_alone():
    row = np.array([1.0, 3.0, np.nan, 5.0, 7.0])
    trace = _trace(10.0 * np.arange(5), power_W=row, chip_degC=row)
    held = straight(trace, ["chip_degC"], "zero-order")
    np.testing.assert_array_equal(held.columns["power_W"], [1.0, 2.0, np.nan, 5.0, 6.0])
    np.testing.assert_array_equal(held.columns["chip_degC"], row)
    assert straight(trace, ["chip_degC"], "first-order") is trace
