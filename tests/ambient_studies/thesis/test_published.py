"""The published results are whole, agree with themselves, and tell of the sensors what the data files say."""

from __future__ import annotations

import csv
from importlib import resources

import numpy as np
import pytest
from scipy.stats import norm

from ambient_studies.thesis.methods import MODELS
from ambient_studies.thesis.parameters import published_parameters
from ambient_studies.thesis.published import published_results, sensor_statistics

ROUNDING = 0.005 + 1e-9


@pytest.mark.parametrize("name", ["results.csv", "sensor_statistics.csv", "display_mean.csv"])
def test_the_shipped_tables_are_the_originals(thesis_file, name):
    shipped = (resources.files("ambient_studies.thesis") / name).read_text()
    assert list(csv.reader(shipped.splitlines())) == list(csv.reader(thesis_file(name).splitlines()))


def test_ten_models_in_six_scenarios():
    assert set(published_results()) == {(s, m) for s in ("1", "2.1", "2.3", "2.4", "3", "4") for m in MODELS}
    verification = published_results()["4", "model2_ss_free_cd"]
    assert (verification.rmse_degC, verification.mae_degC, verification.mbe_degC) == (1.30, 0.92, 0.11)
    assert verification.interval_degC == {50: (-0.76, 0.99), 90: (-2.02, 2.25), 98: (-2.90, 3.13)}


@pytest.mark.parametrize(("scenario", "model"), list(published_results()))
def test_intervals_are_mean_and_quantile_times_sigma_of_the_same_row(scenario, model):
    """sigma from the 98 % interval (the widest rounds least) must give the other intervals, and the row's RMSE."""
    each = published_results()[scenario, model]
    low, high = each.interval_degC[98]
    sigma = (high - low) / (2 * norm.ppf(0.99))
    for level, band in each.interval_degC.items():
        reach = norm.ppf(0.5 + level / 200) * sigma
        # both ends and the mean are rounded, and so is sigma
        np.testing.assert_allclose(band, (each.mbe_degC - reach, each.mbe_degC + reach), atol=4 * ROUNDING)
    # sigma is over N - 1, RMSE over N
    assert np.hypot(each.mbe_degC, sigma) == pytest.approx(each.rmse_degC, rel=1.5e-3, abs=2 * ROUNDING)
    assert each.mae_degC <= each.rmse_degC + ROUNDING
    assert abs(each.mbe_degC) <= each.mae_degC + 2 * ROUNDING


@pytest.mark.parametrize("scenario", ["1", "2.1", "2.3", "2.4"])
@pytest.mark.parametrize("sensor", ["battery", "usb", "flash"])
def test_a_sensors_statistics_follow_from_its_linear_models_errors(scenario, sensor):
    """With T_hat = k T + m and truth 20: mean(T) = (20 - MBE - m)/k, std(T) = sqrt(RMSE^2 - MBE^2)/k."""
    line = published_parameters()[f"linear_{sensor}"].printed
    errors = published_results()[scenario, f"linear_{sensor}"]
    found = sensor_statistics()[scenario, sensor]
    assert found.mean_degC == pytest.approx((20 - errors.mbe_degC - line["m"]) / line["k"], abs=0.02)
    spread = np.sqrt(errors.rmse_degC**2 - errors.mbe_degC**2) / line["k"]
    # the difference of two rounded squares
    assert found.std_degC == pytest.approx(spread, rel=0.01, abs=0.02 / max(spread, 0.1))


def test_of_the_display_only_the_mean_is_known():
    assert {key: each for key, each in sensor_statistics().items() if key[1] == "display"}.keys() == {
        (scenario, "display") for scenario in ("1", "2.1", "2.3", "2.4")
    }
    assert sensor_statistics()["2.3", "display"].mean_degC == 25.57
    assert sensor_statistics()["2.3", "display"].std_degC is None
