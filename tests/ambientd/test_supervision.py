"""What is believed of the readings, and when what failed is tried again: rules of time, without a clock."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.model import Input
from ambientd.sources.supervision import BackOff, Rules, Supervision

from .conftest import BATTERY, USB

SOC = Input("soc", "degC", "cpu-0-0", -20.0, 110.0)
CURRENT = Input("battery_current", "A", "", -5.0, 5.0)


def doubted(inputs, rules, moments):
    """Per index the times at which it was not believed."""
    supervision = Supervision(inputs, rules)
    times = {}
    for now_s, values in moments:
        for index in supervision.doubts(now_s, values):
            times.setdefault(index, []).append(now_s)
    return times


def tried(times_s):
    back_off = BackOff()
    return [now_s for now_s in times_s if back_off.due(now_s)]


def test_what_stays_away_is_tried_less_and_less_often():
    assert tried(map(float, range(200))) == [0, 1, 2, 4, 8, 16, 32, 64, 96, 128, 160, 192]
    assert tried(k / 10 for k in range(90)) == [0.0, 0.1, 1.1, 3.1, 7.1]


def test_what_was_well_for_long_is_tried_at_once_again():
    back_off = BackOff()
    for now_s in (0.0, 1.0, 2.0, 4.0):
        assert back_off.due(now_s)
    assert not back_off.due(7.9)
    assert back_off.due(8.0 + 64.0)
    assert back_off.due(72.5)


JUMPS = Rules(jump_K_per_s=5.0)


def test_a_spike_is_set_aside_until_ten_seconds_are_calm():
    moments = [(float(k), [30.0, 80.0 if k == 2 else 25.0]) for k in range(40)]
    assert doubted([USB, BATTERY], JUMPS, moments) == {1: [float(k) for k in range(2, 13)]}


def test_what_keeps_jumping_is_never_believed():
    moments = [(float(k), [30.0 + 20.0 * (k // 7 % 2)]) for k in range(200)]
    assert doubted([USB], JUMPS, moments) == {0: [float(k) for k in range(7, 200)]}


def test_a_coarse_sensor_read_often_does_not_jump():
    """One K from one twentieth of a second to the next is the resolution of many."""
    moments = [(k / 20, [30.0 + k // 30]) for k in range(900)]
    assert doubted([USB], Rules(jump_K_per_s=2.0), moments) == {}


@settings(derandomize=True, deadline=None)
@given(st.lists(st.tuples(st.floats(0.05, 300), st.floats(-1, 1), st.booleans()), max_size=50))
def test_what_changes_within_the_limit_never_jumps(steps):
    now_s, value, moments = 0.0, 30.0, [(0.0, [30.0])]
    since_s = 0.0
    for step_s, part, missing in steps:
        now_s += step_s
        since_s += step_s
        if missing:
            moments.append((now_s, [None]))
        else:
            value += part * 4.99 * max(1.0, since_s)
            since_s = 0.0
            moments.append((now_s, [value]))
    assert doubted([USB], JUMPS, moments) == {}


def test_a_current_may_jump_and_stand_still():
    rules = Rules(stuck_after_s=60.0, jump_K_per_s=1.0)
    jumping = [(float(k), [4.0 * (k % 2), 30.0]) for k in range(300)]
    standing = [(float(k), [0.0, 30.0 + k / 50]) for k in range(300)]
    assert doubted([CURRENT, USB], rules, jumping) == {}
    assert doubted([CURRENT, USB], rules, standing) == {}


STUCK = Rules(stuck_after_s=600.0)


def test_what_stands_still_while_the_others_move_is_stuck_until_it_moves():
    moments = [(float(k), [30.0 + k / 100, 25.0 if k < 900 else 25.1, 40.0 - k / 100]) for k in range(1200)]
    assert doubted([USB, BATTERY, SOC], STUCK, moments) == {1: [float(k) for k in range(601, 900)]}


@pytest.mark.parametrize(
    "readings",
    [
        lambda k: [30.0, 25.0, 40.0],
        lambda k: [30.0 + 0.9 * (k % 2), 25.0, 40.0 + 1.9 * (k % 3 == 0)],
        lambda k: [None, 25.0, None],
        lambda k: [30.0 + k / 100, 25.0 + k // 500, 40.0],
    ],
    ids=["all quiet", "the others flicker", "no others", "it moves now and then, and one of two others does not"],
)
def test_a_quiet_device_is_not_stuck(readings):
    moments = [(float(k), readings(k)) for k in range(5000)]
    assert 1 not in doubted([USB, BATTERY, SOC], STUCK, moments)


def test_one_other_of_three_that_moves_is_not_enough():
    case = Input("case", "degC", "case", -20.0, 70.0)
    moments = [(float(k), [30.0, 25.0, 22.0, 40.0 + 30.0 * (k % 2)]) for k in range(5000)]
    assert doubted([USB, BATTERY, case, SOC], STUCK, moments) == {}


@pytest.mark.parametrize(
    ("rules", "spike"),
    [(Rules(stuck_after_s=60.0, jump_K_per_s=5.0), 70.0), (Rules(stuck_after_s=60.0), 125.0)],
    ids=["it jumps", "it leaves its range"],
)
def test_one_that_is_not_believed_is_no_witness_against_the_others(rules, spike):
    moments = [(float(k), [spike if k % 30 > 26 else 30.0, 25.0]) for k in range(600)]
    assert 1 not in doubted([USB, BATTERY], rules, moments)


def test_the_same_reading_on_both_sides_of_a_suspend_is_not_stuck():
    moments = [(float(k), [30.0, 25.0]) for k in range(500)]
    moments += [(4000.0 + k, [45.0, 25.0]) for k in range(500)]
    assert doubted([USB, BATTERY], STUCK, moments) == {}


def test_what_was_stuck_before_a_suspend_is_stuck_after_it():
    moments = [(float(k), [30.0 + k / 100, 25.0]) for k in range(700)]
    moments += [(700.0, [None, None])]
    moments += [(4000.0 + k, [30.0, 25.0]) for k in range(10)]
    expected = [*map(float, range(601, 700)), *(4000.0 + k for k in range(10))]
    assert doubted([USB, BATTERY], STUCK, moments) == {1: expected}


def test_a_dead_sensor_that_flickers_stands_still_within_a_width():
    moments = [(float(k), [30.0 + k / 100, 25.44 + 0.03 * (k % 3)]) for k in range(1000)]
    assert doubted([USB, BATTERY], STUCK, moments) == {}
    assert doubted([USB, BATTERY], STUCK._replace(stuck_within_K=0.1), moments) == {
        1: [float(k) for k in range(601, 1000)]
    }


def test_the_dead_zone_of_a_real_phone_is_set_aside_and_no_other(beside):
    """A Galaxy S25+ for 17 hours: its AMBIENT zone says 25.44 to 25.50 degC, also in the cold."""
    with open(beside("measured/s25plus-zones/s25_zones_tidy.csv")) as stream:
        header, *rows = (line.rstrip("\n").split(",")[:8] for line in stream)
    inputs = [Input(name, "degC", name, -40.0, 120.0) for name in header[1:]]
    start_s = float(rows[0][0])
    moments = [(float(row[0]) - start_s, [float(cell) if cell else None for cell in row[1:]]) for row in rows]
    found = doubted(inputs, Rules(stuck_after_s=1800.0, stuck_within_K=0.1), moments)
    assert [inputs[index].name for index in found] == ["T_ambient"]
    (times_s,) = found.values()
    assert len(times_s) > 0.95 * len(rows)
    there_s = [now_s for now_s, values in moments if values[-1] is not None]
    assert times_s == there_s[-len(times_s) :]  # once gone, it never comes back


def test_others_that_come_after_it_began_to_stand_count():
    moments = [(float(k), [None if k < 50 else 30.0 + k / 100, 25.0]) for k in range(700)]
    assert doubted([USB, BATTERY], STUCK, moments) == {1: [float(k) for k in range(601, 700)]}


@settings(derandomize=True, deadline=None)
@given(st.lists(st.lists(st.none() | st.sampled_from([20.0, 20.1, 35.0]), min_size=2, max_size=2), max_size=200))
def test_what_is_missing_is_never_doubted(rows):
    supervision = Supervision([USB, BATTERY], Rules(stuck_after_s=10.0, jump_K_per_s=3.0))
    for k, values in enumerate(rows):
        assert all(values[index] is not None for index in supervision.doubts(float(k), values))
