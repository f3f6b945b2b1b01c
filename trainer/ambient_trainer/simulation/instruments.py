"""What instruments add to true temperatures: noise, calibration, rounding. Their lag is part of the heat balance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.simulation import constants as c

Array = NDArray[np.float64]


def sensor_reading(lagged_degC: Array, random: np.random.Generator) -> Array:
    """What a sensor of the phone reports, shape (n,)."""
    return np.round(lagged_degC + c.SENSOR_NOISE_DEGC * random.standard_normal(len(lagged_degC)), c.SENSOR_DIGITS)


def probe_reading(lagged_degC: Array, random: np.random.Generator) -> Array:
    """The mean of the probes in the air, each with its own constant calibration error, shape (n,)."""
    calibration = c.PROBE_CALIBRATION_DEGC * random.standard_normal(c.PROBES)
    noise = c.PROBE_NOISE_DEGC * random.standard_normal((len(lagged_degC), c.PROBES))
    mean: Array = lagged_degC + (calibration + noise).mean(axis=1)
    return np.round(mean, c.PROBE_DIGITS)
