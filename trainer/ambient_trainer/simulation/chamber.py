"""The chamber's air: it follows the set point at a limited rate, and wobbles slowly about it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_trainer.simulation.constants import CHAMBER_RAMP_K_S, CHAMBER_WOBBLE_DEGC, CHAMBER_WOBBLE_S

Array = NDArray[np.float64]


def ramped(set_point_degC: Array, period_s: float) -> Array:
    """The air's mean temperature where ``set_point_degC``, shape (n,), is asked for; it starts settled."""
    reach = CHAMBER_RAMP_K_S * period_s
    air = float(set_point_degC[0])
    result = np.empty_like(set_point_degC)
    for index, wanted in enumerate(set_point_degC.tolist()):
        result[index] = air
        air += min(max(wanted - air, -reach), reach)
    return result


def wobble(count: int, period_s: float, random: np.random.Generator) -> Array:
    """Stationary first-order noise in K, shape (count,), whose statistics do not depend on the period."""
    kept = math.exp(-period_s / CHAMBER_WOBBLE_S)
    white = CHAMBER_WOBBLE_DEGC * random.standard_normal(count)
    white[1:] *= math.sqrt(1.0 - kept * kept)
    return np.asarray(lfilter([1.0], [1.0, -kept], white))
