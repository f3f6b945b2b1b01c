"""What instruments make of true temperatures: lag, noise, calibration, rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.device import Phone
from ambient_trainer.simulator.zones import Zone, weights

Array = NDArray[np.float64]


class Sound:
    """Instruments without faults; what has some overrides what they touch. Arrays have the shape (n,)."""

    def felt(self, zone: str, felt_degC: Array) -> Array:
        """What ``zone``'s sensor has itself as temperature."""
        return felt_degC

    def read(self, zone: str, reading_degC: Array, step_degC: float) -> Array:
        """What ``zone`` reports, in steps of ``step_degC``."""
        return reading_degC

    def air(self, air_degC: Array) -> Array:
        """The air that the reference's record is about, sample by sample."""
        return air_degC


def felt(zone: Zone, phone: Phone, nodes_degC: Array, period_s: float) -> Array:
    """What a zone's sensor has itself as temperature, shape (n,), from the nodes', shape (n, nodes)."""
    return lagged(nodes_degC @ felt_weights(zone, phone), zone.lag_s, period_s)


def felt_weights(zone: Zone, phone: Phone) -> Array:
    """How much of every node a zone's sensor feels, shape (nodes,)."""
    return np.array(weights(zone, phone.share.get(zone.name, 0.0) if zone.share is None else zone.share))


def zone_reading(zone: Zone, felt_degC: Array, random: np.random.Generator) -> Array:
    """What the zone reports, shape (n,)."""
    return reported(zone, felt_degC, random.standard_normal(len(felt_degC)))


def reported(zone: Zone, felt_degC: Array, noise: Array) -> Array:
    """What the zone reports with ``noise`` of unit variance, of the same shape."""
    noisy = felt_degC + zone.offset_degC + zone.noise_degC * noise
    return np.round(np.round(noisy / zone.step_degC) * zone.step_degC, 6)


def probe_reading(air_degC: Array, period_s: float, random: np.random.Generator) -> Array:
    """The mean of the probes in the air, each with its own constant calibration error, shape (n,)."""
    calibration = c.PROBE_CALIBRATION_DEGC * random.standard_normal(c.PROBES)
    noise = c.PROBE_NOISE_DEGC * random.standard_normal((len(air_degC), c.PROBES))
    mean: Array = lagged(air_degC, c.PROBE_LAG_S, period_s) + (calibration + noise).mean(axis=1)
    return np.round(mean, c.PROBE_DIGITS)
