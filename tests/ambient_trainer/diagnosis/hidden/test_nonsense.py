"""Data without information are refused or answered with ``unknown``: never with a cause."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Cause
from refusals import refused

SENSORS = ("chip_degC", "board_degC", "shell_degC")
BOTH_WAYS = pytest.mark.parametrize("baseline", [False, True], ids=["bare", "baseline"])
PERIOD_S = 60.0


@pytest.fixture(scope="module")
def trace(boxed):
    """A run in which nothing is wrong."""
    return boxed(NONE, 1)


@pytest.fixture
def verdict(box, boxed):
    """The verdict on a trace, by its circuit alone or beside a known-good run."""
    good = [boxed(NONE, 101)]
    return lambda trace, baseline: diagnose(box, [trace], good if baseline else [], period_s=PERIOD_S).verdict_cause


def with_columns(trace, **columns):
    return replace(trace, columns={**trace.columns, **columns})


def shuffled(trace, random):
    order = random.permutation(len(trace.time_s))
    return {name: values[order] for name, values in trace.columns.items()}


def still(trace, random):
    sensors = {name: 20 + 0.05 * random.standard_normal(len(trace.time_s)) for name in SENSORS}
    return {"ambient_degC": np.full(len(trace.time_s), 20.0), "chip_power_W": 0.0 * trace.time_s, **sensors}


NONSENSE = {
    "rows in any order": (shuffled, (UNKNOWN,)),
    "an ambient that never moves": (lambda trace, random: {"ambient_degC": 21.0 + 0 * trace.time_s}, (UNKNOWN,)),
    "a sensor of noise": (lambda trace, random: {"board_degC": random.normal(30, 5, len(trace.time_s))}, (UNKNOWN,)),
    "nothing that moves": (still, (NONE, UNKNOWN)),
    "a signal without a value": (lambda trace, random: {"radio_on": np.nan * trace.time_s}, (NONE,)),
}


@pytest.mark.slow
@BOTH_WAYS
@pytest.mark.parametrize("what", NONSENSE)
def test_no_cause_is_named(verdict, trace, what, baseline):
    columns, allowed = NONSENSE[what]
    assert verdict(with_columns(trace, **columns(trace, np.random.default_rng(5))), baseline).name in allowed


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 4])
def test_a_reference_that_is_a_sensor_and_noise(verdict, boxed, seed):
    trace = boxed(NONE, seed)
    noise = 0.05 * np.random.default_rng(5).standard_normal(len(trace.time_s))
    assert verdict(with_columns(trace, ambient_degC=trace.columns["shell_degC"] + noise), True) == Cause(UNKNOWN)


@BOTH_WAYS
@pytest.mark.parametrize("decimals", [1, 9])
def test_a_reference_that_is_a_sensor_is_refused(verdict, trace, decimals, baseline):
    copied = with_columns(trace, ambient_degC=trace.columns["board_degC"].round(decimals))
    assert "ambient_degC is board_degC" in str(refused(verdict, copied, baseline))


@BOTH_WAYS
def test_ten_samples_are_refused(verdict, trace, baseline):
    few = replace(trace, time_s=trace.time_s[:10], columns={k: v[:10] for k, v in trace.columns.items()})
    alike = with_columns(few, ambient_degC=few.columns["board_degC"])
    (fault,) = refused(verdict, alike, baseline).faults
    assert "at least 100" in str(fault).partition("10 samples")[2]


@BOTH_WAYS
@pytest.mark.parametrize("empty", [("board_degC",), ("ambient_degC",), ("chip_power_W",), SENSORS], ids="-".join)
def test_a_column_without_any_value_is_refused(verdict, trace, empty, baseline):
    said = str(refused(verdict, with_columns(trace, **dict.fromkeys(empty, np.nan * trace.time_s)), baseline))
    assert all(f"{name} holds no value" in said for name in empty)


def test_what_cannot_be_simulated_is_refused(verdict, trace):
    rising = with_columns(trace, ambient_degC=np.where(trace.time_s > 600, 1e7, 20.0))
    assert "cannot be simulated" in str(refused(verdict, rising, False))


def test_a_constant_room_is_no_nonsense_where_the_load_varies(box, boxed):
    """The lid is closed: a shell that loses less is no warmer room, for the load tells them apart."""
    normal, closed = boxed(NONE, 101, room_degC=21.0), boxed("ambient_coupling", 1, room_degC=21.0)
    verdict = diagnose(box, [closed], [normal], period_s=PERIOD_S).verdict
    assert verdict.cause.name == "ambient_coupling"
    assert verdict.magnitude.value == pytest.approx(0.25 / 0.15 - 1, rel=0.05)
