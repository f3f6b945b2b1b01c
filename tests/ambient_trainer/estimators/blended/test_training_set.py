"""An ambient like the log's is made up: what makes it has to come back from a log that is known."""

import numpy as np
import pytest

from ambient_trainer.estimators.blended.training_set import fit_ambient


def test_a_swing_a_slope_and_noise_come_back():
    random = np.random.default_rng(1)
    count = 8 * 720
    time_s = 5.0 * np.arange(count)
    noise = np.zeros(count)
    for k in range(1, count):
        noise[k] = 0.9 * noise[k - 1] + 0.1 * np.sqrt(1 - 0.81) * random.standard_normal()
    steps = np.interp(time_s, [0, 7200, 8200, 28_000], [10, 10, 40, 40])
    found = fit_ambient([steps + 0.8 * np.sin(2 * np.pi * time_s / 900) + noise], 5.0, "log")
    assert found.swing_K == pytest.approx(0.8, rel=0.05)
    assert found.swing_period_s == pytest.approx(900, rel=0.02)
    assert found.noise_K == pytest.approx(0.1, rel=0.2)
    assert found.noise_memory == pytest.approx(0.9, abs=0.05)
    assert found.slope_K_s == pytest.approx(0.03 + 0.8 * 2 * np.pi / 900, rel=0.1)
