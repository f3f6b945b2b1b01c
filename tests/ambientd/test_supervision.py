"""What is believed of the readings, and when what failed is tried again: rules of time, without a clock."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.model import Input
from ambientd.sources.supervision import BackOff, Rules, Supervision

from .conftest import BATTERY, USB

SOC = Input("soc", "degC", "cpu-0-0", -20.0, 110.0)
CASE = Input("case", "degC", "case", -20.0, 70.0)
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


def test_what_stays_away_is_tried_less_and_less_often_and_at_once_again_after_it_was_well_for_long():
    assert tried(map(float, range(200))) == [0, 1, 2, 4, 8, 16, 32, 64, 96, 128, 160, 192]
    assert tried(k / 10 for k in range(90)) == [0.0, 0.1, 1.1, 3.1, 7.1]
    assert tried([0.0, 1.0, 2.0, 4.0, 7.9, 8.0 + 64.0, 72.5]) == [0.0, 1.0, 2.0, 4.0, 8.0 + 64.0, 72.5]


JUMPS, STUCK = Rules(jump_K_per_s=5.0), Rules(stuck_after_s=600.0)
BOTH = Rules(stuck_after_s=60.0, jump_K_per_s=1.0)


def each_second(count, readings, from_s=0.0):
    """Moments a second apart, with the readings of each."""
    return [(from_s + k, readings(k)) for k in range(count)]


def seconds(first, end):
    return [float(k) for k in range(first, end)]


SPIKE = each_second(40, lambda k: [30.0, 80.0 if k == 2 else 25.0])
JUMPING = each_second(200, lambda k: [30.0 + 20.0 * (k // 7 % 2)])
COARSE = [(k / 20, [30.0 + k // 30]) for k in range(900)]  # one K more is the resolution of many
CURRENT_JUMPS = each_second(300, lambda k: [4.0 * (k % 2), 30.0])
CURRENT_STANDS = each_second(300, lambda k: [0.0, 30.0 + k / 50])
STANDS = each_second(1200, lambda k: [30.0 + k / 100, 25.0 if k < 900 else 25.1, 40.0 - k / 100])
ONE_MOVES = each_second(5000, lambda k: [30.0, 25.0, 22.0, 40.0 + 30.0 * (k % 2)])
SUSPENDED = each_second(500, lambda k: [30.0, 25.0]) + each_second(500, lambda k: [45.0, 25.0], 4000.0)
STUCK_BEFORE = [*each_second(700, lambda k: [30.0 + k / 100, 25.0]), (700.0, [None, None])]
STUCK_BEFORE += each_second(10, lambda k: [30.0, 25.0], 4000.0)
FLICKERS = each_second(1000, lambda k: [30.0 + k / 100, 25.44 + 0.03 * (k % 3)])
OTHERS_COME = each_second(700, lambda k: [None if k < 50 else 30.0 + k / 100, 25.0])
OTHERS_FLICKER = each_second(5000, lambda k: [30.0 + 0.9 * (k % 2), 25.0, 40.0 + 1.9 * (k % 3 == 0)])
NOW_AND_THEN = each_second(5000, lambda k: [30.0 + k / 100, 25.0 + k // 500, 40.0])
KEEPS_JUMPING = each_second(5000, lambda k: [70.0 if k % 30 > 26 else 30.0, 25.0])
LEAVES_ITS_RANGE = each_second(5000, lambda k: [125.0 if k % 30 > 26 else 30.0, 25.0])
PAIR, WITHIN = [USB, BATTERY], STUCK._replace(stuck_within_K=0.1)
ALL, UNCALM = [*PAIR, SOC], [now_s for now_s in seconds(27, 5000) if (now_s - 27) % 30 < 13]
# the inputs, the rules, the moments, and per index when it is not believed
NOT_BELIEVED = {
    "a spike is set aside until ten seconds are calm": (PAIR, JUMPS, SPIKE, {1: seconds(2, 13)}),
    "what keeps jumping is never believed": ([USB], JUMPS, JUMPING, {0: seconds(7, 200)}),
    "a coarse sensor read often does not jump": ([USB], Rules(jump_K_per_s=2.0), COARSE, {}),
    "a current may jump": ([CURRENT, USB], BOTH, CURRENT_JUMPS, {}),
    "a current may stand still": ([CURRENT, USB], BOTH, CURRENT_STANDS, {}),
    "what stands still is stuck until it moves": (ALL, STUCK, STANDS, {1: seconds(601, 900)}),
    "one other of three that moves is not enough": ([*PAIR, CASE, SOC], STUCK, ONE_MOVES, {}),
    "the same on both sides of a suspend is not stuck": (PAIR, STUCK, SUSPENDED, {}),
    "stuck before a suspend and after it": (PAIR, STUCK, STUCK_BEFORE, {1: seconds(601, 700) + seconds(4000, 4010)}),
    "a dead sensor that flickers does not stand still": (PAIR, STUCK, FLICKERS, {}),
    "within a width it does": (PAIR, WITHIN, FLICKERS, {1: seconds(601, 1000)}),
    "others that come after it began to stand count": (PAIR, STUCK, OTHERS_COME, {1: seconds(601, 700)}),
    "where all is quiet none is stuck": (ALL, STUCK, each_second(5000, lambda k: [30.0, 25.0, 40.0]), {}),
    "nor where the others flicker": (ALL, STUCK, OTHERS_FLICKER, {}),
    "nor without others": (ALL, STUCK, each_second(5000, lambda k: [None, 25.0, None]), {}),
    "what moves now and then is not stuck, one of two others is": (ALL, STUCK, NOW_AND_THEN, {2: seconds(601, 5000)}),
    "what jumps is no witness": (PAIR, BOTH._replace(jump_K_per_s=5.0), KEEPS_JUMPING, {0: UNCALM}),
    "what leaves its range is no witness": (PAIR, Rules(stuck_after_s=60.0), LEAVES_ITS_RANGE, {}),
}


@pytest.mark.parametrize(("inputs", "rules", "moments", "expected"), NOT_BELIEVED.values(), ids=NOT_BELIEVED)
def test_when_a_reading_is_not_believed(inputs, rules, moments, expected):
    assert doubted(inputs, rules, moments) == expected


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


@given(st.lists(st.lists(st.none() | st.sampled_from([20.0, 20.1, 35.0]), min_size=2, max_size=2), max_size=200))
def test_what_is_missing_is_never_doubted(rows):
    supervision = Supervision([USB, BATTERY], Rules(stuck_after_s=10.0, jump_K_per_s=3.0))
    for k, values in enumerate(rows):
        assert all(values[index] is not None for index in supervision.doubts(float(k), values))
