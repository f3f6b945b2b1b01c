"""A fleet is drawn: units of a device within its tolerances, bare or in a case, each using it in its own way.

The tolerances stand in the device's file. Where one is a bound, what is drawn is uniform within it; where it is what
parts of one make scatter by, it is normal, or log-normal for what cannot be negative. A case is 1 to 2 mm of TPU and
0.2 to 0.5 mm of air under it against 20 W/(m2 K), and 25 to 40 g: conduction, R = d/k.

Usage: each unit begins the scenario at a step of its own and goes round; before, it was settled at that step's
temperature. The same seed gives the same unit, however many others there are.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.device import Device, Tolerances, Zone, load_device
from ambient_trainer.simulator.hidden import Hidden
from ambient_trainer.simulator.run import Progress, stream
from ambient_trainer.simulator.scenario import Scenario, ScenarioStep, load_scenario
from ambient_trainer.simulator.simulate import Planned, logged, planned
from ambient_trainer.simulator.text import hidden_text, parse_hidden

_MOST_SHARE = 0.98

_TPU_W_mK, _AIR_W_mK, _OUTSIDE_W_m2K = 0.2, 0.026, 20.0
_TPU_mm, _AIR_mm = (1.0, 2.0), (0.2, 0.5)
_TPU_g, _TPU_J_gK = (25.0, 40.0), 1.6


@dataclass(frozen=True)
class Unit:
    """One phone, its sensors, and the case that it may be put into; number 0 is the nominal one."""

    number: int
    phone: Device
    zones: tuple[Zone, ...]
    gains: Mapping[str, float]
    """By zone the relative error of the slope."""
    case: tuple[Hidden, ...]
    """What it does to each side of the device: the convective resistance grows by a share of it, and it stores heat."""


def nominal(zones: Sequence[Zone]) -> Unit:
    """The calibrated phone, in the middle of all tolerances."""
    phone, middle = load_device(), (sum(each) / 2 for each in (_TPU_mm, _AIR_mm, _TPU_g))
    return Unit(0, phone, tuple(zones), {}, _case(phone, *middle))


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
        _case(shipped, *(case.uniform(*each) for each in (_TPU_mm, _AIR_mm, _TPU_g))),
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
    idle, load = _scatter(tolerances.idle_power, random), _scatter(tolerances.load_power, random)
    values = {
        f"activities.{name}.heat_W.{node}": heat_W * (idle if name == phone.idle else load)
        for name, activity in phone.activities.items()
        for node, heat_W in activity.heat_W.items()
    }
    for name, node in sorted(phone.nodes.items()):
        values[f"nodes.{name}.capacitance_J_K"] = node.capacitance_J_K * _scatter(tolerances.capacitance, random)
    for edge, value in sorted(phone.conductance_W_K.items()):
        values[f"conductance_W_K.{edge}"] = value * _scatter(tolerances.conductance, random)
    values["convection_W_m2_K125"] = phone.convection_W_m2_K125 * _scatter(tolerances.loss, random)
    radiated = _scatter(tolerances.loss, random)
    values |= {f"nodes.{name}.emissivity": min(node.emissivity * radiated, 1.0) for name, node in phone.nodes.items()}
    if phone.battery:
        values["battery.ohm"] = phone.battery.ohm * _scatter(tolerances.battery_ohm, random)
    return phone.with_values(values)


def _case(device: Device, plastic_mm: float, air_mm: float, mass_g: float) -> tuple[Hidden, ...]:
    """Nothing where the device has no sides that a case covers."""
    resistance_m2K_W = 1e-3 * (plastic_mm / _TPU_W_mK + air_mm / _AIR_W_mK)
    does = ("ambient_coupling", resistance_m2K_W * _OUTSIDE_W_m2K), ("thermal_mass", mass_g * _TPU_J_gK)
    return tuple(Hidden(cause, side, size=size) for side in device.sides for cause, size in does)


def _scatter(deviation: float, random: np.random.Generator) -> float:
    """A factor, log-normal with the median 1."""
    return math.exp(deviation * random.standard_normal())


def unit_run(
    unit: Unit,
    cased: bool,
    of: tuple[str, int],
    scenario: Scenario,
    period_s: float,
    hidden: Sequence[tuple[Hidden, str]] = (),
    decoys: Sequence[str] = (),
) -> Planned:
    """A unit in a run ``of`` a scenario's name and a seed, in its case since ever or bare, with what else is hidden."""
    case = [(each, "case") for each in unit.case * cased]
    return planned(of, scenario, unit.phone, unit.zones, period_s, [*hidden, *case], decoys, unit.gains)


_AT_ONCE = 50
_RUNS_APART = 1_000_003


@dataclass(frozen=True)
class FleetPlan:
    """``count`` units of ``seed`` in a scenario, each logged for ``minutes`` (None: all of it) every ``period_s``.

    A share ``cased`` of them is in a case for good. Each effect of ``hide`` is hidden in one unit, another for each.
    ``run`` is the number of the recording: another one has the same units in another usage.
    """

    scenario: str
    count: int
    seed: int = 0
    period_s: float = 1.0
    minutes: float | None = None
    cased: float = 0.5
    hide: tuple[str, ...] = ()
    run: int = 0
    device: str = "phone"


@dataclass(frozen=True)
class FleetUnit:
    """What one unit logs, and the truth about it."""

    name: str
    trace: Trace
    case: str
    truth: Mapping[str, Any]


def fleet(plan: FleetPlan, progress: Progress | None = None) -> Iterator[FleetUnit]:
    """The units of ``plan``, one after the other, simulated fifty at a time.

    Raises :class:`Refused` for a scenario, device or effect with faults, and more effects than units.
    """
    device, scenario = load_device(plan.device), load_scenario(plan.scenario)
    if len(plan.hide) > plan.count:
        raise refuse("--hide", "", f"{len(plan.hide)} effects for {plan.count} units", "hide fewer, or draw more units")
    chosen = stream(plan.seed, "units with an effect").choice(plan.count, len(plan.hide), replace=False) + 1
    duration_s = scenario.duration_s if plan.minutes is None else 60 * plan.minutes
    hidden = {
        int(number): parse_hidden([text], plan.seed + int(number), duration_s, device)
        for number, text in zip(chosen, plan.hide)
    }
    for first in range(1, plan.count + 1, _AT_ONCE):
        numbers = range(first, min(first + _AT_ONCE, plan.count + 1))
        units = [_unit(plan, device, scenario, number, hidden) for number in numbers]
        done = logged([run for _, run in units], plan.period_s)
        for (truth, _), (trace, *_) in zip(units, done):
            yield FleetUnit(truth["unit"], replace(trace, path=truth["unit"]), truth["case"], truth)
        if progress:
            progress(numbers[-1], plan.count)


def _unit(
    plan: FleetPlan, device: Device, scenario: Scenario, number: int, all_hidden: Mapping[int, Sequence[Hidden]]
) -> tuple[dict[str, Any], Planned]:
    """The truth about a unit, and its run; what drives an effect in one unit is logged in all: they have one form."""
    hidden = all_hidden.get(number, ())
    signals = [each.signal for of_one in all_hidden.values() for each in of_one if each.signal]
    unit = drawn(number, plan.seed, device.main_zones, device)
    cased = bool(unit.case) and bool(stream(plan.seed, f"unit {number} cased").uniform() < plan.cased)
    seed = _RUNS_APART * (plan.seed + 1) + 10_000_019 * plan.run + number
    usage = _usage(scenario, seed, plan.minutes)
    named = [(each, f"hidden {each.cause} {each.location}") for each in hidden]
    truth = {
        "unit": f"u{number:05d}",
        "case": "on" if cased else "off",
        "offset_K": {zone.name: zone.offset_degC for zone in unit.zones},
        "gain": dict(unit.gains),
        "hidden": [{"text": hidden_text(each), "cause": each.cause, "location": each.location} for each in hidden],
    }
    return truth, unit_run(unit, cased, (plan.scenario, seed), usage, plan.period_s, named, signals)


def _usage(scenario: Scenario, seed: int, minutes: float | None) -> Scenario:
    """The scenario from a step of the unit's own on, round and round, for so many minutes."""
    begin = int(stream(seed, "usage").integers(len(scenario.steps)))
    left = scenario.duration_s / 60 if minutes is None else minutes
    steps: list[ScenarioStep] = []
    while left > 1e-9:
        step = scenario.steps[(begin + len(steps)) % len(scenario.steps)]
        lasting = min(step.duration_min or left, left)
        steps.append(step.model_copy(update={"duration_min": lasting}))
        left -= lasting
    before = tuple(
        each.model_copy(update={"chamber_degC": steps[0].chamber_degC, "duration_min": each.duration_min or 15.0})
        for each in scenario.before
    )
    return scenario.model_copy(update={"steps": tuple(steps), "before": before})
