"""When a step is over and what ends a run, with synthetic times, temperatures and readings."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.campaign import ChamberLimits, Safety
from ambient_trainer.laboratory.messages import StepBegan
from ambient_trainer.laboratory.program import Program, SafetyLimits
from ambient_trainer.simulator.scenario import ScenarioStep, Settle


def timed(minutes, degC=20.0):
    return ScenarioStep(duration_min=minutes, chamber_degC=degC)


def settling(within=1.0, drift=None, minutes=10.0, most=60.0, duration=None, degC=20.0):
    settle = Settle(within_K=within, drift_K=drift, for_min=minutes, at_most_min=most)
    return ScenarioStep(chamber_degC=degC, settle=settle, duration_min=duration)


def run(program, until_s, ambient, zones=lambda t: {}, every_s=1.0):
    """What begins when, asked every so often."""
    found, now_s = [], 0.0
    while now_s <= until_s and not program.over:
        program.update(now_s, ambient(now_s), zones(now_s))
        found += program.advance(now_s)
        now_s += every_s
    return found


@given(st.lists(st.floats(0.05, 30.0), min_size=1, max_size=8), st.floats(0.1, 700.0))
def test_delays_of_who_asks_do_not_add_up(minutes, every_s):
    program = Program([timed(each) for each in minutes], 0.0)
    found = run(program, 60.0 * sum(minutes) + 2 * every_s, lambda t: None, every_s=every_s)
    ends = [60.0 * sum(minutes[: k + 1]) for k in range(len(minutes))]
    assert [each.at_s for each, _ in found] == pytest.approx(ends)
    assert [each.step for each, _ in found] == list(range(1, len(minutes) + 1))
    assert program.over


def test_a_run_goes_on_in_the_middle_of_a_step():
    program = Program([timed(1), timed(10), timed(1)], 5000.0, step=1, elapsed_s=400.0)
    assert program.advance(5199.0) == []
    assert program.advance(5201.0) == [(StepBegan(5200.0, 2, 0.0), False)]
    assert program.advance(6000.0) == [(StepBegan(5260.0, 3, 0.0), False)]


@pytest.mark.parametrize(
    ("step", "ambient", "zones", "end"),
    [
        (settling(), lambda t: 25.0 if t < 100 or 300 <= t < 310 else 20.9, lambda t: {}, (310.0 + 600.0, False)),
        (settling(), lambda t: None if t == 500 else 20.0, lambda t: {}, (501.0 + 600.0, False)),
        (settling(drift=0.5), lambda t: 20.0, lambda t: {} if t < 300 else {"usb_degC": 20.0}, (900.0, False)),
        (settling(most=20), lambda t: 30.0, lambda t: {}, (1200.0, True)),
        (settling(duration=15), lambda t: 20.0, lambda t: {}, (900.0, False)),
        (settling(duration=15), lambda t: 20.0 if t > 600 else 0.0, lambda t: {}, (1201.0, False)),
        (settling(degC=None), lambda t: 30.0 - 0.01 * min(t, 450.0), lambda t: {}, (404.0 + 600.0, False)),
    ],
    ids=["swings", "gap", "zones missing", "given up", "duration is longer", "settling is longer", "desk"],
)
def test_when_a_steady_state_ends_a_step(step, ambient, zones, end):
    assert run(Program([step], 0.0), 5000, ambient, zones) == [(StepBegan(end[0], 1, 0.0), end[1])]


SAFETY = Safety(
    set_point_degC=20.0,
    chamber=ChamberLimits(low_degC=-20.0, high_degC=60.0, margin_K=3.0),
    device_high_degC={"battery_degC": 50.0, "soc_degC": 100.0},
    ambient_lost_s=120.0,
)


@pytest.fixture
def watch():
    return SafetyLimits(SAFETY, 1000.0)


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"chamber_degC": 62.9, "chamber_set_degC": 900.0}, None),
        ({"chamber_degC": -22.9}, None),
        ({"battery_degC": 50.0, "soc_degC": None, "usb_degC": 900.0}, None),
        ({"chamber_degC": 63.1}, ("chamber", "63.1", "60")),
        ({"chamber_degC": -23.1}, ("chamber", "-23.1", "-20")),
        ({"battery_degC": 50.1}, ("battery_degC", "50.1", "50")),
        ({"battery_degC": 20.0, "soc_degC": 101.0}, ("soc_degC", "101", "100")),
    ],
)
def test_a_limit_that_is_crossed_once_is_crossed(values, parts, watch):
    watch.check(values)
    watch.check(dict.fromkeys(values, 25.0))
    violation = watch.violation(1001.0)
    assert violation is None if parts is None else all(part in violation for part in parts)


def test_the_ambient_is_limited_and_may_not_be_lost_for_long(watch):
    assert (watch.violation(1120.0), watch.violation(1121.0) is None) == (None, False)  # no probe ever answered
    watch.check_ambient(1150.0, 62.9)
    watch.check_ambient(1200.0, None)
    assert watch.violation(1270.0) is None
    assert "121 s" in watch.violation(1271.0)
    watch.check_ambient(1272.0, 20.0)
    assert watch.violation(1273.0) is None
    watch.check_ambient(1274.0, 64.0)
    assert "64.0" in watch.violation(1274.0)
