"""A made phone: sensors that wander each in its own way, with drives, and an ambient to be filled in by a test."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from ambient_trainer.data.trace import Trace

SENSORS = ("soc_degC", "flash_degC", "battery_degC", "usb_degC", "display_degC")


def wandering(samples: int, seed: int, period_s: float = 5.0) -> Trace:
    """Five smooth, independent temperatures about 25 degC, a battery current up to 2 A out of it, an idle half."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) * period_s

    def smooth(width: float) -> np.ndarray:
        found = gaussian_filter1d(rng.standard_normal(samples), width, mode="wrap")
        return found / found.std()

    columns = {name: 25.0 + 8.0 * smooth(4.0 + 3.0 * index) for index, name in enumerate(SENSORS)}
    busy = (np.arange(samples) // (samples // 8)) % 2
    columns["ambient_degC"] = 20.0 + 5.0 * smooth(20.0)
    columns["cpu_load_frac"] = np.where(busy == 1, 0.8, 0.02)
    columns["charging_on"] = np.zeros(samples)
    columns["battery_current_A"] = -np.abs(smooth(5.0))
    return Trace(f"made {seed}", time_s, columns)


@pytest.fixture(scope="session")
def made() -> Callable[..., Trace]:
    return wandering
