"""The chamber's air: it follows the set point at a limited rate, settles behind it, and swings slowly about it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.device import Chamber

Array = NDArray[np.float64]


def ramped(set_point_degC: Array, period_s: float, chamber: Chamber) -> Array:
    """The air's mean temperature where ``set_point_degC``, shape (n,), is asked for; it starts settled."""
    up, down = chamber.heating_K_min / 60.0 * period_s, chamber.cooling_K_min / 60.0 * period_s
    now = float(set_point_degC[0])
    ramp = np.empty_like(set_point_degC)
    for index, wanted in enumerate(set_point_degC.tolist()):
        ramp[index] = now
        now += min(max(wanted - now, -down), up)
    return lagged(ramp, c.CHAMBER_SETTLING_S, period_s)


def wobble(count: int, period_s: float, chamber: Chamber, random: np.random.Generator) -> Array:
    """The swing of the controller, from a random phase on, and draughts, in K, shape (count,)."""
    phase = random.uniform(0.0, 2.0 * math.pi)
    swing = np.sin(2.0 * math.pi / c.CHAMBER_WOBBLE_PERIOD_S * period_s * np.arange(count) + phase)
    return chamber.wobble_degC * swing + c.CHAMBER_DRAUGHT_DEGC * coloured(count, period_s, c.CHAMBER_DRAUGHT_S, random)


def coloured(count: int, period_s: float, memory_s: float, random: np.random.Generator) -> Array:
    """Stationary first-order noise of unit variance, shape (count,); its statistics do not depend on the period."""
    kept = math.exp(-period_s / memory_s)
    white = random.standard_normal(count)
    white[1:] *= math.sqrt(1.0 - kept * kept)
    return np.asarray(lfilter([1.0], [1.0, -kept], white))
