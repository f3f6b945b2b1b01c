"""The metrics against the textbook and scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ambient_trainer.evaluation.metrics import coverage, rolling_band, score, widened_coverage


@given(st.lists(st.floats(-50, 50), min_size=2, max_size=40))
def test_the_figures_are_the_sums_of_the_textbook(errors):
    n = len(errors)
    mean = sum(errors) / n
    sigma = (sum((e - mean) ** 2 for e in errors) / (n - 1)) ** 0.5
    metrics = score(np.array(errors))
    assert metrics.samples == n
    assert metrics.rmse_degC == pytest.approx((sum(e * e for e in errors) / n) ** 0.5, abs=1e-9)
    assert metrics.mae_degC == pytest.approx(sum(abs(e) for e in errors) / n, abs=1e-9)
    assert metrics.mbe_degC == pytest.approx(mean, abs=1e-9)
    assert metrics.sigma_degC == pytest.approx(sigma, abs=1e-9)
    assert list(metrics.interval_degC) == [50, 90, 98]
    for level, band in metrics.interval_degC.items():
        z = stats.norm.ppf(0.5 + level / 200)
        assert band == pytest.approx((mean - z * sigma, mean + z * sigma), abs=1e-9)


def test_the_rolling_band_is_of_twenty_samples_around_each_and_steps_over_what_is_missing():
    error = np.random.default_rng(2).normal(size=70).cumsum()
    low, high = rolling_band(error)
    for k in range(10, 61):
        window = error[k - 10 : k + 10]
        expected = stats.norm.interval(0.98, loc=window.mean(), scale=window.std(ddof=1))
        assert (low[k], high[k]) == pytest.approx(expected, abs=1e-9)
    for end in (low, high):
        assert (set(end[:11]), set(end[-10:])) == ({end[10]}, {end[60]})
    error = np.random.default_rng(3).normal(size=50)
    holed, band = (np.insert(each, [7, 25, 25], np.nan, axis=-1) for each in (error, rolling_band(error)))
    np.testing.assert_array_equal(rolling_band(holed), band)
    assert np.isnan(rolling_band(np.zeros(19))).all()


def test_coverage_counts_the_ends_as_inside_and_takes_a_scale_an_error():
    error = np.array([-1.0, -0.5, 0.0, 0.5, 2.0])
    assert coverage(error, {50: (-0.5, 0.5), 90: (-1.0, 1.0), 98: (-9.0, 9.0)}) == {50: 0.6, 90: 0.8, 98: 1.0}
    error, scale = np.array([-2.0, -0.9, 0.9, 2.0]), np.array([2.0, 1.0, 0.5, 0.25])
    # -1 to 1.5 times the scale: -2 to 3, -1 to 1.5, -0.5 to 0.75, -0.25 to 0.375
    assert coverage(error, {90: (-1.0, 1.5)}, scale) == {90: 0.5}
    assert coverage(error, {90: (-1.0, 1.5)}) == {90: 0.5}
    assert coverage(error, {50: (-1.0, 1.5), 98: (-1.0, 2.0)}, 10.0) == {50: 1.0, 98: 1.0}
    ends = np.array([[-2.0] * 4, [2.0] * 4])  # a variance of 3 / 1.645^2 more: at 50 % to 0.71 beside nothing
    assert widened_coverage(error / 1.3, ends, {50: (0.0, 0.0), 90: (-1.0, 1.0)}) == {50: 0.5, 90: 1.0}
