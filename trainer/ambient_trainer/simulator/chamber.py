"""A climate chamber and its probes: air that follows the set point at a limited rate, settles, and swings about it."""

import math

import numpy as np
from scipy.signal import lfilter

from ambient_trainer.data.strict_yaml import Strict
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged


class Probes(Strict):
    """The thermocouples in the chamber's air, whose mean is the reference."""

    count: int = 4  # the thesis: several, averaged
    lag_s: float = 4.0  # chosen: a bare thermocouple in moving air
    calibration_degC: float = 0.1  # standard deviation of each one's constant error; the thesis's reference thermometer
    noise_degC: float = 0.02  # standard deviation; chosen
    digits: int = 3

    def reading(self, air_degC: Array, period_s: float, random: np.random.Generator) -> Array:
        """The mean of the probes in the air, each with its own constant calibration error, shape (n,)."""
        calibration = self.calibration_degC * random.standard_normal(self.count)
        noise = self.noise_degC * random.standard_normal((len(air_degC), self.count))
        mean: Array = lagged(air_degC, self.lag_s, period_s) + (calibration + noise).mean(axis=1)
        return np.round(mean, self.digits)


class Chamber(Strict):
    """The chamber's air: the controller's ramp, its swing about the set point, and draughts."""

    heating_K_min: float
    cooling_K_min: float
    wobble_degC: float
    """Amplitude of the controller's swing."""
    wobble_period_s: float = 900.0  # chosen
    settling_s: float = 60.0  # of the air behind the controller's ramp; chosen
    draught_degC: float = 0.08  # standard deviation of what is irregular; chosen
    draught_s: float = 60.0  # how long a draught lasts; chosen
    probes: Probes = Probes()


def ramped(set_point_degC: Array, period_s: float, chamber: Chamber, gradient_K_min: Array | float = math.inf) -> Array:
    """The air's mean temperature where ``set_point_degC``, shape (n,), is asked for; it starts settled.

    The set point moves by ``gradient_K_min`` at most, shape (n,).
    """
    up, down = (
        (np.minimum(rate, gradient_K_min) / 60.0 * period_s + 0.0 * set_point_degC).tolist()
        for rate in (chamber.heating_K_min, chamber.cooling_K_min)
    )
    now = float(set_point_degC[0])
    ramp = np.empty_like(set_point_degC)
    for index, wanted in enumerate(set_point_degC.tolist()):
        ramp[index] = now
        now += min(max(wanted - now, -down[index]), up[index])
    return lagged(ramp, chamber.settling_s, period_s)


def wobble(count: int, period_s: float, chamber: Chamber, random: np.random.Generator) -> Array:
    """The swing of the controller, from a random phase on, and draughts, in K, shape (count,)."""
    phase = random.uniform(0.0, 2.0 * math.pi)
    swing = np.sin(2.0 * math.pi / chamber.wobble_period_s * period_s * np.arange(count) + phase)
    return chamber.wobble_degC * swing + chamber.draught_degC * coloured(count, period_s, chamber.draught_s, random)


def coloured(count: int, period_s: float, correlation_s: float, random: np.random.Generator) -> Array:
    """Stationary first-order noise of unit variance, shape (count,); its statistics do not depend on the period."""
    kept = math.exp(-period_s / correlation_s)
    white = random.standard_normal(count)
    white[1:] *= math.sqrt(1.0 - kept * kept)
    return np.asarray(lfilter([1.0], [1.0, -kept], white))
