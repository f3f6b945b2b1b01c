"""A unit is the calibrated phone as one came off the line: everything within its tolerance, drawn from a seed.

Where a tolerance is a bound, what is drawn is uniform within it; where it is what parts of one make scatter by, it is
normal, or log-normal for what cannot be negative.

| what | scatter | where from |
| --- | --- | --- |
| thermistor, offset | +-1 % of it and +-1 % of its pull-up, at 4.4 %/K: +-0.23 K each | usual grade of phones' NTCs |
| thermistor, gain about 25 degC | +-1 % of B, which bends by +-1 % about there | the same grade |
| sensor on silicon, offset and gain | sd 1 K, sd 1 % | assumption: trimmed at one temperature, +-3 K at 3 sigma |
| lag of a sensor | sd 20 % | assumption: glue and paste |
| share of the second node that a sensor feels | sd 10 % | assumption: placement |
| conductance within the phone | sd 15 % | assumption: contacts, gaps and glue |
| heat capacity | sd 3 % | assumption: masses of parts |
| convection and emissivity | sd 3 % | assumption: surface, posture on the foam |
| power in standby, of silicon | sd 30 % | assumption: leakage, which within a process varies most |
| power under load | sd 5 % | assumption: supply voltage by bin, converters |
| resistance of the cell | sd 10 % | assumption: make and age |
| case | 1 to 2 mm of TPU and 0.2 to 0.5 mm of air under it against 20 W/(m2 K); 25 to 40 g | conduction: R = d/k |
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.simulator.device import Phone
from ambient_trainer.simulator.instruments import Sound
from ambient_trainer.simulator.run import stream
from ambient_trainer.simulator.zones import Zone

Array = NDArray[np.float64]

GAIN_REFERENCE_DEGC = 25.0
_NTC_PER_K = 0.044
_NTC_RESISTANCE, _NTC_PULL_UP, _NTC_B = 0.01, 0.01, 0.01
_SILICON_OFFSET_K, _SILICON_GAIN = 1.0, 0.01
_SILICON_NOISE_DEGC = 0.1
"""Sensors that are this noisy, or more so, are diodes: see zones.yaml."""
_LAG, _SHARE, _CONDUCTANCE, _CAPACITANCE = 0.2, 0.1, 0.15, 0.03
_LOSS, _STANDBY, _LOAD, _CELL = 0.03, 0.3, 0.05, 0.1
_MOST_SHARE = 0.98

_TPU_W_mK, _AIR_W_mK, _OUTSIDE_W_m2K = 0.2, 0.026, 20.0
_TPU_mm, _AIR_mm = (1.0, 2.0), (0.2, 0.5)
_TPU_g, _TPU_J_gK = (25.0, 40.0), 1.6


@dataclass(frozen=True)
class Case:
    """What a case does to the rear shell: the convective resistance grows by this share of it, and it stores heat."""

    resistance_frac: float
    capacitance_J_K: float


@dataclass(frozen=True)
class Unit:
    """One phone, its sensors, and the case that it may be put into; number 0 is the nominal one."""

    number: int
    phone: Phone
    zones: tuple[Zone, ...]
    gains: Mapping[str, float]
    """By zone the relative error of the slope, about 25 degC."""
    case: Case


@dataclass(frozen=True)
class Skewed(Sound):
    """A unit's instruments, each with its own error of gain."""

    gains: Mapping[str, float]

    def felt(self, zone: str, felt_degC: Array) -> Array:
        """What ``zone``'s sensor makes of its own temperature."""
        return felt_degC + self.gains.get(zone, 0.0) * (felt_degC - GAIN_REFERENCE_DEGC)


def nominal(zones: Sequence[Zone]) -> Unit:
    """The calibrated phone, in the middle of all tolerances."""
    return Unit(0, Phone.shipped(), tuple(zones), {}, _case(sum(_TPU_mm) / 2, sum(_AIR_mm) / 2, sum(_TPU_g) / 2))


def drawn(number: int, seed: int, zones: Sequence[Zone]) -> Unit:
    """Unit ``number`` of ``seed``: the same however many others are drawn, and whatever zones are asked for."""
    sensors = {zone.name: _Sensor.drawn(zone, stream(seed, f"unit {number} sensor {zone.name}")) for zone in zones}
    shipped = Phone.shipped()
    shares = {
        name: min(share * _scatter(_SHARE, stream(seed, f"unit {number} share {name}")), _MOST_SHARE)
        for name, share in shipped.share.items()
    }
    case = stream(seed, f"unit {number} case")
    return Unit(
        number,
        replace(_assembled(shipped, stream(seed, f"unit {number} phone")), share=shares),
        tuple(sensors[zone.name].of(zone) for zone in zones),
        {name: sensor.gain for name, sensor in sensors.items()},
        _case(case.uniform(*_TPU_mm), case.uniform(*_AIR_mm), case.uniform(*_TPU_g)),
    )


@dataclass(frozen=True)
class _Sensor:
    offset_K: float
    gain: float
    lag: float

    @staticmethod
    def drawn(zone: Zone, random: np.random.Generator) -> _Sensor:
        lag = _scatter(_LAG, random)
        if zone.noise_degC >= _SILICON_NOISE_DEGC:
            return _Sensor(random.normal(0.0, _SILICON_OFFSET_K), random.normal(0.0, _SILICON_GAIN), lag)
        offset_K = (random.uniform(-1, 1) * _NTC_RESISTANCE + random.uniform(-1, 1) * _NTC_PULL_UP) / _NTC_PER_K
        return _Sensor(offset_K, random.uniform(-_NTC_B, _NTC_B), lag)

    def of(self, zone: Zone) -> Zone:
        return zone.model_copy(update={"offset_degC": zone.offset_degC + self.offset_K, "lag_s": zone.lag_s * self.lag})


def _assembled(phone: Phone, random: np.random.Generator) -> Phone:
    def scattered(values: Mapping[str, float], spread: float) -> dict[str, float]:
        return {name: value * _scatter(spread, random) for name, value in sorted(values.items())}

    standby, load = _scatter(_STANDBY, random), _scatter(_LOAD, random)
    power = {name: value * (standby if name.startswith("idle.") else load) for name, value in phone.power_W.items()}
    return replace(
        phone,
        capacitance_J_K=scattered(phone.capacitance_J_K, _CAPACITANCE),
        conductance_W_K=scattered(phone.conductance_W_K, _CONDUCTANCE),
        power_W=power,
        convection_W_m2_K125=phone.convection_W_m2_K125 * _scatter(_LOSS, random),
        emissivity=min(phone.emissivity * _scatter(_LOSS, random), 1.0),
        battery_ohm=phone.battery_ohm * _scatter(_CELL, random),
    )


def _case(plastic_mm: float, air_mm: float, mass_g: float) -> Case:
    resistance_m2K_W = 1e-3 * (plastic_mm / _TPU_W_mK + air_mm / _AIR_W_mK)
    return Case(resistance_m2K_W * _OUTSIDE_W_m2K, mass_g * _TPU_J_gK)


def _scatter(spread: float, random: np.random.Generator) -> float:
    """A factor, log-normal with the median 1."""
    return math.exp(spread * random.standard_normal())
