"""A unit is the calibrated phone as one came off the line: everything within its tolerance, drawn from a seed.

The tolerances stand in the device's file. Where one is a bound, what is drawn is uniform within it; where it is what
parts of one make scatter by, it is normal, or log-normal for what cannot be negative. A case is 1 to 2 mm of TPU and
0.2 to 0.5 mm of air under it against 20 W/(m2 K), and 25 to 40 g: conduction, R = d/k.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.simulator.additions import Added, together
from ambient_trainer.simulator.device import Device, Tolerances, Zone
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.hidden import Acting, Hidden
from ambient_trainer.simulator.run import Run, stream
from ambient_trainer.simulator.simulate import setting_of

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
    phone: Device
    zones: tuple[Zone, ...]
    gains: Mapping[str, float]
    """By zone the relative error of the slope."""
    case: Case


def nominal(zones: Sequence[Zone]) -> Unit:
    """The calibrated phone, in the middle of all tolerances."""
    return Unit(0, load_device(), tuple(zones), {}, _case(sum(_TPU_mm) / 2, sum(_AIR_mm) / 2, sum(_TPU_g) / 2))


def drawn(number: int, seed: int, zones: Sequence[Zone], device: Device | None = None) -> Unit:
    """Unit ``number`` of ``seed``: the same however many others are drawn, and whatever zones are asked for.

    Raises :class:`Refused` for a device without tolerances.
    """
    shipped = device or load_device()
    tolerances = shipped.tolerances
    if tolerances is None:
        raise refuse("--device", "tolerances", "the device has none", "say in its file by what its units differ")
    case = stream(seed, f"unit {number} case")
    made = [_made(zone, shipped, tolerances, number, seed) for zone in zones]
    return Unit(
        number,
        _assembled(shipped, tolerances, stream(seed, f"unit {number} phone")),
        tuple(zone for zone, _ in made),
        {zone.name: gain for zone, gain in made},
        _case(case.uniform(*_TPU_mm), case.uniform(*_AIR_mm), case.uniform(*_TPU_g)),
    )


def _made(zone: Zone, device: Device, tolerances: Tolerances, number: int, seed: int) -> tuple[Zone, float]:
    """A zone with its sensor's own errors, and the sensor's error of gain."""
    random, made = stream(seed, f"unit {number} sensor {zone.name}"), tolerances.sensors[zone.sensor]

    def error(size: float) -> float:
        return float(random.normal(0.0, size) if made.drawn == "normal" else random.uniform(-size, size))

    share, lag = zone.share, _scatter(tolerances.lag, random)
    offset_K, gain = sum(map(error, made.offset_K)), error(made.gain)
    if zone.beside and zone.name in device.sensors:
        share = min(share * _scatter(tolerances.share, stream(seed, f"unit {number} share {zone.name}")), _MOST_SHARE)
    changed = {"offset_degC": zone.offset_degC + offset_K, "lag_s": zone.lag_s * lag, "share": share}
    return zone.model_copy(update=changed), gain


def _assembled(phone: Device, tolerances: Tolerances, random: np.random.Generator) -> Device:
    def scattered(values: Mapping[str, float], deviation: float) -> dict[str, float]:
        return {name: value * _scatter(deviation, random) for name, value in sorted(values.items())}

    idle, load = _scatter(tolerances.idle_power, random), _scatter(tolerances.load_power, random)
    values = {
        f"activities.{name}.heat_W.{node}": heat_W * (idle if name == phone.idle else load)
        for name, activity in phone.activities.items()
        for node, heat_W in activity.heat_W.items()
    }
    capacitances = {name: node.capacitance_J_K for name, node in phone.nodes.items()}
    for name, value in scattered(capacitances, tolerances.capacitance).items():
        values[f"nodes.{name}.capacitance_J_K"] = value
    for edge, value in scattered(phone.conductance_W_K, tolerances.conductance).items():
        values[f"conductance_W_K.{edge}"] = value
    values["convection_W_m2_K125"] = phone.convection_W_m2_K125 * _scatter(tolerances.loss, random)
    radiated = _scatter(tolerances.loss, random)
    values |= {f"nodes.{name}.emissivity": min(node.emissivity * radiated, 1.0) for name, node in phone.nodes.items()}
    if phone.battery:
        values["battery.ohm"] = phone.battery.ohm * _scatter(tolerances.battery_ohm, random)
    return phone.with_values(values)


def case_of(unit: Unit, run: Run, period_s: float, seed: int) -> Added:
    """What the unit's case adds to ``run``: it covers the rear shell since ever."""
    setting = setting_of(run, period_s)
    effects = (
        Hidden("ambient_coupling", "back", size=unit.case.resistance_frac),
        Hidden("thermal_mass", "back", size=unit.case.capacitance_J_K),
    )
    acting = (Acting(each, setting, partial(stream, seed, "case")) for each in effects)
    return together([each.part(number) for number, each in enumerate(acting)])


def _case(plastic_mm: float, air_mm: float, mass_g: float) -> Case:
    resistance_m2K_W = 1e-3 * (plastic_mm / _TPU_W_mK + air_mm / _AIR_W_mK)
    return Case(resistance_m2K_W * _OUTSIDE_W_m2K, mass_g * _TPU_J_gK)


def _scatter(deviation: float, random: np.random.Generator) -> float:
    """A factor, log-normal with the median 1."""
    return math.exp(deviation * random.standard_normal())
