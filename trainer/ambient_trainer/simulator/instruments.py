"""What instruments make of true temperatures: lag, noise, calibration, rounding, and what is wrong with them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.chamber import Probes
from ambient_trainer.simulator.device import Device, Zone
from ambient_trainer.simulator.hidden import Acting

GAIN_REFERENCE_DEGC = 25.0


@dataclass(frozen=True)
class Instruments:
    """The instruments of a run, with what is wrong with them; each is used once a run."""

    gains: Mapping[str, float] = field(default_factory=dict)
    """By zone the relative error of the slope, about :data:`GAIN_REFERENCE_DEGC`."""
    acting: Sequence[Acting] = ()

    def felt(self, zone: str, felt_degC: Array) -> Array:
        """The temperature of ``zone``'s sensor itself, shape (n,)."""
        felt_degC = felt_degC + self.gains.get(zone, 0.0) * (felt_degC - GAIN_REFERENCE_DEGC)
        for each in self._at(zone):
            felt_degC = each.effect.felt(each, felt_degC)
        return felt_degC

    def read(self, zone: str, reading_degC: Array, step_degC: float) -> Array:
        """What ``zone`` reports, shape (n,), in steps of ``step_degC``."""
        for each in self._at(zone):
            reading_degC = each.effect.read(each, reading_degC, step_degC)
        return reading_degC

    def air(self, air_degC: Array) -> Array:
        """The air that the reference records, shape (n,)."""
        for each in self.acting:
            air_degC = each.effect.air(each, air_degC)
        return air_degC

    def _at(self, zone: str) -> list[Acting]:
        return [each for each in self.acting if each.hidden.location == zone]


def felt(zone: Zone, device: Device, nodes_degC: Array, period_s: float) -> Array:
    """The temperature of a zone's sensor, shape (n,), from the nodes', shape (n, nodes)."""
    return lagged(nodes_degC @ felt_weights(zone, device), zone.lag_s, period_s)


def felt_weights(zone: Zone, device: Device) -> Array:
    """How much of every node a zone's sensor feels, shape (nodes,); they sum to one."""
    return device.pattern({zone.near: 1.0 - zone.share, **({zone.beside: zone.share} if zone.beside else {})})


def zone_reading(zone: Zone, felt_degC: Array, random: np.random.Generator) -> Array:
    """What the zone reports, shape (n,)."""
    return reported(zone, felt_degC, random.standard_normal(len(felt_degC)))


def reported(zone: Zone, felt_degC: Array, noise: Array) -> Array:
    """What the zone reports with ``noise`` of unit variance, of the same shape."""
    noisy = felt_degC + zone.offset_degC + zone.noise_degC * noise
    return np.round(np.round(noisy / zone.step_degC) * zone.step_degC, 6)


def probe_reading(air_degC: Array, period_s: float, random: np.random.Generator, probes: Probes | None = None) -> Array:
    """The mean of the probes in the air, each with its own constant calibration error, shape (n,)."""
    probes = probes or Probes()
    calibration = probes.calibration_degC * random.standard_normal(probes.count)
    noise = probes.noise_degC * random.standard_normal((len(air_degC), probes.count))
    mean: Array = lagged(air_degC, probes.lag_s, period_s) + (calibration + noise).mean(axis=1)
    return np.round(mean, probes.digits)
