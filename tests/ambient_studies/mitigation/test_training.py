"""The identification of a phone of known constants, and the training run."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_studies.mitigation.comparison import identify
from ambient_trainer.data.trace import Trace


def known_phone(noise_degC):
    """A skin of first order: 2.5 K per W, 240 s; the sensor stands 10 K per W above it at once."""
    random = np.random.default_rng(3)
    count = 12_000
    air = 20 + 15 * np.repeat(random.uniform(-1, 1, 12), 1000)
    power_W = np.repeat(random.uniform(0, 4, 40), 300)
    power_W[:300] = 0.0  # it starts in steady state
    kept = np.exp(-1 / 240)
    # held from sample to sample, as the simulation holds it
    heated = np.concatenate([[0.0], lfilter([1 - kept], [1, -kept], 2.5 * power_W)[:-1]])
    walls = np.empty(count)
    walls[0] = air[0]
    for k in range(1, count):
        walls[k] = kept * walls[k - 1] + (1 - kept) * air[k - 1]
    skin = walls + heated
    columns = {
        "soc_degC": skin + 10 * power_W,
        "air_degC": air,
        "soc_power_W": power_W,
        "ambient_degC": skin + random.normal(0, noise_degC, count),
    }
    return Trace("known", np.arange(count, dtype=float), columns)


def test_a_known_phone_is_recovered():
    fitted = identify(known_phone(0.01))
    assert fitted.sensor == "soc"
    assert fitted.resistance_K_W == pytest.approx(2.5, rel=0.01)
    assert fitted.time_constant_s == pytest.approx(240, rel=0.01)
    # in steady state: skin = air + 2.5 P and sensor = air + 12.5 P
    assert fitted.dc_gains == pytest.approx((0.2, 0.8), abs=0.01)


def test_the_margin_is_what_the_skin_was_hotter_than_predicted():
    quiet, noisy = identify(known_phone(0.01)), identify(known_phone(0.5))
    # 95 % of a normal error lie below 1.645 standard deviations
    assert noisy.margin_K == pytest.approx(1.645 * 0.5, abs=0.05)
    assert 0 <= quiet.margin_K < 0.05


def test_the_training_run_is_scenario_5(trained, logged):
    assert list(trained.columns) == ["soc_degC", "air_degC", "soc_power_W", "ambient_degC"]
    assert np.array_equal(trained.columns["soc_degC"], logged.columns["soc_degC"])
    assert np.array_equal(trained.columns["soc_power_W"], logged.columns["soc_power_W"])
    assert np.array_equal(trained.columns["air_degC"], logged.reference)
    # the skin is between air and die, and warm under load
    above = trained.reference - logged.reference
    loaded = trained.columns["soc_power_W"] > 3
    assert above[loaded].mean() > 3
    assert (trained.reference < trained.columns["soc_degC"] + 3).all()


def test_the_shipped_phone_is_plausible(identified):
    sensor, ambient = identified.dc_gains
    assert 0 < sensor < 0.3
    assert sensor + ambient == pytest.approx(1, abs=0.05)
    assert 2 < identified.resistance_K_W < 3.5
