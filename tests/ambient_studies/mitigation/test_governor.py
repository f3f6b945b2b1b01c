"""The law by hand, and its loop about a phone of first order against the solution of its differential equation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_studies.mitigation.governor import FLOOR_W, SPEED, Governor

from .sample_report import first_order

R, TAU, SHARE = 3.0, 300.0, 0.25
GAIN = (SPEED - 1) / R
TARGET = 40.0 - 0.5
TOP = 9.0


def only(value):
    return np.array([value])


def steady_sensor(skin_degC, ambient_degC):
    """The sensor under which the skin stays where it is."""
    return (skin_degC - (1 - SHARE) * ambient_degC) / SHARE


def test_in_steady_state_the_cap_is_the_budget_and_what_the_headroom_adds():
    governor = Governor(first_order(), 40.0, TOP, 1.0, only(35.0))
    for _ in range(50):
        cap_W = governor.cap_W(only(steady_sensor(38.0, 30.0)), only(30.0), only(0.0))
    assert governor.skin_degC == pytest.approx([38.0])
    assert cap_W == pytest.approx([(TARGET - 30.0) / R + GAIN * (TARGET - 38.0)])


def test_only_a_cap_that_binds_is_corrected():
    governor = Governor(first_order(), 40.0, TOP, 2.0, only(35.0))
    inputs = only(steady_sensor(39.0, 34.0)), only(34.0)
    first_W = governor.cap_W(*inputs, only(0.0))
    assert governor.cap_W(*inputs, only(0.9 * first_W[0])) == pytest.approx(first_W)
    assert governor.cap_W(*inputs, first_W) == pytest.approx(first_W + GAIN / TAU * 2.0 * (TARGET - 39.0))


def test_the_loop_follows_its_differential_equation():
    """With e = target - skin: tau e' = -4 e - R I and I' = k/tau e, so e is a sum of exp(-t/tau) and exp(-3 t/tau)."""
    ambient, period_s, start_K = 33.0, 0.25, 1.5
    governor = Governor(first_order(), 40.0, TOP, period_s, only(35.0))
    skin = TARGET - start_K
    drawn = only((skin - ambient) / R)
    kept = np.exp(-period_s / TAU)
    for k in range(8000):
        t = k * period_s
        expected = start_K * (1.5 * np.exp(-3 * t / TAU) - 0.5 * np.exp(-t / TAU))
        assert TARGET - skin == pytest.approx(expected, abs=0.005 * start_K)
        # a die that is at once as warm as its power makes it, behind which the skin lags
        drawn = governor.cap_W(only(ambient + R / SHARE * drawn[0]), only(ambient), drawn)
        skin = kept * skin + (1 - kept) * (ambient + R * drawn[0])


def test_without_a_reading_the_cap_is_the_floor():
    governor = Governor(first_order(), 40.0, TOP, 1.0, only(35.0))
    sensor = only(steady_sensor(38.0, 30.0))
    before = governor.cap_W(sensor, only(30.0), only(0.0))
    for _ in range(100):
        assert governor.cap_W(only(np.nan), only(30.0), only(FLOOR_W)).tolist() == [FLOOR_W]
    assert governor.cap_W(sensor, only(30.0), only(FLOOR_W)) == pytest.approx(before)


def test_what_the_top_or_the_floor_holds_back_is_not_integrated():
    for sensor, ambient, held_W, next_degC in ((20.0, 5.0, TOP, 39.0), (90.0, 40.0, FLOOR_W, 20.0)):
        governor = Governor(first_order(), 40.0, TOP, 1.0, only(35.0))
        cap_W = only(0.0)
        for _ in range(500):
            cap_W = governor.cap_W(only(sensor), only(ambient), cap_W)
            assert cap_W == held_W
        cap_W = governor.cap_W(only(sensor), only(next_degC), cap_W)
        assert FLOOR_W < cap_W < TOP
        assert cap_W == pytest.approx((TARGET - next_degC) / R + GAIN * (TARGET - governor.skin_degC))


def test_a_warmer_ambient_never_raises_the_cap():
    identified = first_order()

    @given(sensor=st.floats(-20, 110), ambients=st.lists(st.floats(-20, 60), min_size=2, max_size=2))
    def not_raised(sensor, ambients):
        governor = Governor(identified, 40.0, TOP, 1.0, np.full(2, 35.0))
        cap_W = governor.cap_W(np.full(2, sensor), np.array(sorted(ambients)), np.zeros(2))
        assert FLOOR_W <= cap_W[1] <= cap_W[0] <= TOP

    not_raised()
