"""The offset's Kalman filter: against the batch solution, and what no reference can do to it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.tracking import DEGRADED, TRACKING, Estimate
from ambient_model.unit_offset import OffsetPrior, estimate_variance_degC2, initial, predicted, shifted, updated

DAY_S = 86400.0
LOOSE = OffsetPrior(std_degC=0.5, bound_degC=1e6, forgotten_s=10 * DAY_S)


def test_it_is_the_conditional_mean_and_variance_of_the_ornstein_uhlenbeck_process():
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.1, 3, 12)) * DAY_S
    y, R = random.normal(0.2, 0.3, 12), random.uniform(0.05, 0.5, 12)
    state = initial(LOOSE)
    for time_s, each, variance in zip(times, y, R):
        state = updated(LOOSE, predicted(LOOSE, state, time_s), each, variance)
    last_s = times[-1] + 5 * DAY_S
    state = predicted(LOOSE, state, last_s)
    covariance = 0.25 * np.exp(-np.abs(times[:, None] - times) / LOOSE.forgotten_s)
    cross = 0.25 * np.exp(-(last_s - times) / LOOSE.forgotten_s)
    weights = np.linalg.solve(covariance + np.diag(R), cross)
    assert state.offset_degC == pytest.approx(weights @ y, abs=1e-12)
    assert state.variance_degC2 == pytest.approx(0.25 - weights @ cross, abs=1e-12)


references = st.lists(st.tuples(st.floats(-30, 30), st.floats(0.0025, 500)), max_size=60)


@settings(max_examples=200)
@given(references, st.floats(-DAY_S, 3 * DAY_S))
def test_whatever_is_told_it_stays_within_its_bound(told, apart_s):
    prior = OffsetPrior()
    state = initial(prior)
    for y, R in told:
        state = predicted(prior, state, state.time_s + apart_s)
        state = updated(prior, state, y, R) or state
        assert abs(state.offset_degC) <= prior.bound_degC
        assert 0 < state.variance_degC2 <= prior.std_degC**2 * (1 + 1e-12)


@given(st.floats(7.5, 50), st.floats(0.0025, 1e4), st.sampled_from((-1, 1)))
def test_a_reference_far_off_moves_nothing_however_uncertain_it_claims_to_be(off_degC, R, sign):
    prior = OffsetPrior()
    state = initial(prior)._replace(offset_degC=sign * prior.bound_degC)
    assert updated(prior, state, sign * off_degC, R) is None


def test_estimate_and_interval_move_and_keep_their_width():
    estimate = Estimate(20.0, 19.0, 22.0, TRACKING, (1.0,))
    assert shifted(estimate, 0.5) == Estimate(20.5, 19.5, 22.5, TRACKING, (1.0,))
    assert estimate_variance_degC2(estimate, 90) == pytest.approx((1.5 / 1.645) ** 2)
    nothing = Estimate(None, None, None, "faulted", (None,))
    assert shifted(nothing, 0.5) == nothing
    assert estimate_variance_degC2(nothing, 90) == math.inf


def test_a_degraded_interval_holds_the_offset_that_the_filter_has_already() -> None:
    tracking = Estimate(20.0, 19.0, 21.0, TRACKING, ())
    whole = estimate_variance_degC2(tracking, 90)
    assert estimate_variance_degC2(tracking, 90, 0.25) == whole
    degraded = tracking._replace(status=DEGRADED)
    assert estimate_variance_degC2(degraded, 90, 0.25) == pytest.approx(whole - 0.25)
    assert estimate_variance_degC2(degraded, 90, 1.0) == 0.0
