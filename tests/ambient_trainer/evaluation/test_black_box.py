"""The black box against circuits whose floor is known: where their inputs explain all, the noise is left."""

import numpy as np
import pytest

from ambient_trainer.evaluation.black_box import black_box_residual_degC, black_box_rmse_degC
from ambient_trainer.lti.lag import lagged

NOISE_DEGC = 0.1
SAMPLES, PERIOD_S = 1200, 10.0
TIME_S = PERIOD_S * np.arange(SAMPLES)
BLOCKS = [slice(start, start + 240) for start in range(0, SAMPLES, 240)]


@pytest.fixture(scope="module")
def inputs():
    rng = np.random.default_rng(3)
    ambient = 20 + lagged(np.append(0.0, rng.normal(0, 60, SAMPLES)), 2000.0, PERIOD_S)[1:]
    current = np.repeat(rng.uniform(0, 3, SAMPLES // 40) * (np.arange(SAMPLES // 40) > 0), 40)
    wind = np.repeat(rng.uniform(0, 4, SAMPLES // 50), 50)
    return {"ambient_degC": ambient, "current_A": current, "wind_m_s": wind}


def sensors(inputs: dict[str, np.ndarray], squared: float, hidden: float) -> np.ndarray:
    """Two sensors, of lags 130 s and 900 s, with heat by the current squared and by what is not logged."""
    rng = np.random.default_rng(4)
    heat = squared * inputs["current_A"] ** 2 + hidden * np.repeat(rng.uniform(-1, 1, SAMPLES // 100), 100)
    rows = [lagged(inputs["ambient_degC"] + heat, lag_s, PERIOD_S) for lag_s in (130.0, 900.0)]
    return np.array(rows) + rng.normal(0, NOISE_DEGC, (2, SAMPLES))


def test_noise_is_left_where_lags_and_squares_of_the_inputs_explain_all(inputs):
    rmse = black_box_rmse_degC(TIME_S, inputs, sensors(inputs, 0.0, 0.0), BLOCKS)
    assert 0.99 * NOISE_DEGC < rmse < 1.6 * NOISE_DEGC
    outputs = sensors(inputs, 2.0, 0.0)
    heated = np.std(outputs - sensors(inputs, 0.0, 0.0))
    assert black_box_rmse_degC(TIME_S, inputs, outputs, BLOCKS) < 0.15 * heated


def test_what_no_input_explains_is_left_in_its_sensor(inputs):
    explained = sensors(inputs, 0.0, 0.0)
    outputs = np.array([explained[0], sensors(inputs, 0.0, 5.0)[0]])
    left = np.sqrt(np.nanmean(black_box_residual_degC(TIME_S, inputs, outputs, BLOCKS) ** 2, axis=1))
    own = np.std(outputs[1] - explained[0])
    assert left[0] < 1.3 * NOISE_DEGC
    assert left[1] > 0.9 * own


def test_gaps_in_time_inputs_and_sensors(inputs):
    outputs = sensors(inputs, 0.0, 0.0)
    outputs[1, 200:400] = np.nan
    gapped = {name: np.where(np.arange(SAMPLES) % 97 == 0, np.nan, row) for name, row in inputs.items()}
    there = np.r_[0:500, 700:SAMPLES]
    blocks = [slice(start, start + 200) for start in range(0, 1000, 200)]
    left = black_box_residual_degC(
        TIME_S[there], {name: row[there] for name, row in gapped.items()}, outputs[:, there], blocks
    )
    assert np.array_equal(np.isnan(left), np.isnan(outputs[:, there]))
    assert np.sqrt(np.nanmean(left**2)) < 3 * NOISE_DEGC
