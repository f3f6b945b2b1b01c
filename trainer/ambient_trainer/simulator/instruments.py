"""What instruments make of true temperatures: lag, noise, calibration and rounding."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.chamber import Probes
from ambient_trainer.simulator.device import Device, Zone


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
