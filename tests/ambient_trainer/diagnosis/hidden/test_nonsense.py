"""Data that say nothing are refused or with_feedback with ``unknown``: never with a cause."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Cause

SENSORS = ("chip_degC", "board_degC", "shell_degC")
BOTH_WAYS = pytest.mark.parametrize("baseline", [False, True], ids=["bare", "baseline"])


@pytest.fixture(scope="module")
def normal(boxed):
    """A known-good run."""
    return boxed(NONE, 101)


@pytest.fixture(scope="module")
def trace(boxed):
    """A run in which nothing is wrong."""
    return boxed(NONE, 1)


@pytest.fixture
def random():
    return np.random.default_rng(5)


@pytest.fixture
def verdict(box, normal):
    """What is said of a trace, by its circuit alone or beside a known-good run."""
    return lambda trace, baseline: diagnose(box, [trace], [normal] if baseline else []).verdict_cause


@BOTH_WAYS
def test_rows_in_any_order(verdict, trace, random, baseline):
    order = random.permutation(len(trace.time_s))
    shuffled = {name: values[order] for name, values in trace.columns.items()}
    assert verdict(replace(trace, columns=shuffled), baseline) == Cause(UNKNOWN)


@BOTH_WAYS
def test_an_ambient_that_never_moves_where_the_sensors_do(verdict, trace, with_columns, baseline):
    still = with_columns(trace, ambient_degC=np.full(len(trace.time_s), 21.0))
    assert verdict(still, baseline) == Cause(UNKNOWN)


@BOTH_WAYS
def test_a_sensor_of_pure_noise(verdict, trace, with_columns, random, baseline):
    noise = 30 + 5 * random.standard_normal(len(trace.time_s))
    assert verdict(with_columns(trace, board_degC=noise), baseline) == Cause(UNKNOWN)


@BOTH_WAYS
def test_nothing_that_moves(verdict, trace, with_columns, random, baseline):
    samples = len(trace.time_s)
    sensors = {name: 20 + 0.05 * random.standard_normal(samples) for name in SENSORS}
    still = with_columns(trace, ambient_degC=np.full(samples, 20.0), chip_power_W=np.zeros(samples), **sensors)
    assert verdict(still, baseline).name in (NONE, UNKNOWN)


def test_a_reference_that_is_a_sensor_and_noise(verdict, trace, with_columns, random):
    near = with_columns(trace, ambient_degC=trace.columns["shell_degC"] + 0.05 * random.standard_normal(1080))
    assert verdict(near, True) == Cause(UNKNOWN)


@BOTH_WAYS
@pytest.mark.parametrize("decimals", [1, 9])
def test_a_reference_that_is_a_sensor(verdict, trace, with_columns, decimals, baseline):
    copied = with_columns(trace, ambient_degC=trace.columns["board_degC"].round(decimals))
    with pytest.raises(Refused, match="ambient_degC is board_degC, value by value; log what it stands for"):
        verdict(copied, baseline)


@BOTH_WAYS
def test_ten_samples(verdict, trace, baseline):
    few = replace(trace, time_s=trace.time_s[:10], columns={k: v[:10] for k, v in trace.columns.items()})
    with pytest.raises(Refused, match="10 samples tell nothing of a cause; log at least 100"):
        verdict(few, baseline)


@BOTH_WAYS
@pytest.mark.parametrize("empty", [("board_degC",), ("ambient_degC",), ("chip_power_W",), SENSORS], ids="-".join)
def test_a_column_without_any_value(verdict, trace, with_columns, empty, baseline):
    blank = np.full(len(trace.time_s), np.nan)
    with pytest.raises(Refused) as refused:
        verdict(with_columns(trace, **dict.fromkeys(empty, blank)), baseline)
    for name in empty:
        assert f"{name} holds no value at all; log it, or take a circuit without it" in str(refused.value)


def test_a_signal_without_any_value_drives_nothing(verdict, trace, with_columns):
    assert verdict(with_columns(trace, radio_on=np.full(len(trace.time_s), np.nan)), False) == Cause(NONE)


def test_a_room_that_never_changes_is_no_nonsense_where_the_load_does(box, boxed):
    """The lid is closed: heat that leaves a shell worse is no warmer room, for the load tells them apart."""
    normal, closed = boxed(NONE, 101, room_degC=21.0), boxed("ambient_coupling", 1, room_degC=21.0)
    said = diagnose(box, [closed], [normal])
    assert said.verdict_cause.name == "ambient_coupling"
    assert said.verdict.magnitude.value == pytest.approx(0.25 / 0.15 - 1, rel=0.05)
