"""A fleet is drawn: units within their tolerances, bare or in a case, each using the device in its own way.

Usage: each unit begins the scenario at a step of its own and goes round; before, it was settled at that step's
temperature. The same seed gives the same unit, however many others there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.additions import Added, together
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.hidden import Hidden
from ambient_trainer.simulator.instruments import Instruments
from ambient_trainer.simulator.run import Run, integrate, prepare, stream
from ambient_trainer.simulator.scenario import Scenario, Step, load_scenario
from ambient_trainer.simulator.simulate import FaultyInstruments, added, setting_of, trace_of
from ambient_trainer.simulator.text import hidden_text, parse_hidden
from ambient_trainer.simulator.unit import Skewed, Unit, case_of, drawn

Array = NDArray[np.float64]

CASE_ON, CASE_OFF = "on", "off"
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


def fleet(plan: FleetPlan, progress: Callable[[int, int], None] | None = None) -> Iterator[FleetUnit]:
    """The units of ``plan``, one after the other, simulated fifty at a time.

    Raises :class:`Refused` for a scenario, device or effect with faults, and more effects than units.
    """
    device, scenario = load_device(plan.device), load_scenario(plan.scenario)
    if len(plan.hide) > plan.count:
        raise refuse("--hide", "", f"{len(plan.hide)} effects for {plan.count} units", "hide fewer, or draw more units")
    chosen = stream(plan.seed, "units with an effect").choice(plan.count, len(plan.hide), replace=False) + 1
    duration_s = min(scenario.duration_s, 60 * (plan.minutes or np.inf))
    hidden = {
        int(number): parse_hidden([text], plan.seed + int(number), duration_s, device)
        for number, text in zip(chosen, plan.hide)
    }
    for first in range(1, plan.count + 1, _AT_ONCE):
        numbers = range(first, min(first + _AT_ONCE, plan.count + 1))
        yield from _simulated(plan, device, scenario, numbers, hidden)
        if progress:
            progress(numbers[-1], plan.count)


def _simulated(
    plan: FleetPlan, device: Device, scenario: Scenario, numbers: Sequence[int], hidden: Mapping[int, Sequence[Hidden]]
) -> Iterator[FleetUnit]:
    units = [drawn(number, plan.seed, device.main_zones, device) for number in numbers]
    cased = [stream(plan.seed, f"unit {each} cased").uniform() < plan.cased for each in numbers]
    seeds = [_RUNS_APART * (plan.seed + 1) + 10_000_019 * plan.run + each for each in numbers]
    runs = [
        prepare(_usage(scenario, seed, plan.minutes), seed, plan.period_s, unit.phone)
        for seed, unit in zip(seeds, units)
    ]
    effects = [tuple(hidden.get(number, ())) for number in numbers]
    parts = [
        _added(unit, case, run, seed, each, plan.period_s)
        for unit, case, run, seed, each in zip(units, cased, runs, seeds, effects)
    ]
    for driven, unit, case, seed, each in zip(
        integrate(runs, plan.period_s, None, parts), units, cased, seeds, effects
    ):
        faulty = FaultyInstruments(each, setting_of(driven.run, plan.period_s), partial(_random, seed))
        instruments = _Both(Skewed(unit.gains), faulty)
        trace = trace_of(driven, plan.scenario, seed, plan.period_s, unit.zones, instruments)
        label = CASE_ON if case else CASE_OFF
        truth = {
            "unit": _name(unit),
            "case": label,
            "offset_K": {zone.name: zone.offset_degC for zone in unit.zones},
            "gain": dict(unit.gains),
            "hidden": [{"text": hidden_text(one), "cause": one.cause, "location": one.location} for one in each],
        }
        yield FleetUnit(_name(unit), replace(trace, path=_name(unit)), label, truth)


def _name(unit: Unit) -> str:
    return f"u{unit.number:05d}"


def _usage(scenario: Scenario, seed: int, minutes: float | None) -> Scenario:
    """The scenario from a step of the unit's own on, round and round, for so many minutes."""
    begin = int(stream(seed, "usage").integers(len(scenario.steps)))
    left = scenario.duration_s / 60 if minutes is None else minutes
    steps: list[Step] = []
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


def _added(unit: Unit, cased: bool, run: Run, seed: int, hidden: Sequence[Hidden], period_s: float) -> Added:
    setting = setting_of(run, period_s)
    effects = [added(each, setting, 10 + index, _random(seed, each)) for index, each in enumerate(hidden)]
    return together([*effects, *([case_of(unit, run, period_s, seed)] if cased else [])])


def _random(seed: int, hidden: Hidden) -> np.random.Generator:
    return stream(seed, f"hidden {hidden.cause} {hidden.location}")


@dataclass(frozen=True)
class _Both(Instruments):
    """A unit's own instruments, and what is wrong with them besides."""

    own: Instruments
    faulty: Instruments

    def felt(self, zone: str, felt_degC: Array) -> Array:
        return self.faulty.felt(zone, self.own.felt(zone, felt_degC))

    def read(self, zone: str, reading_degC: Array, step_degC: float) -> Array:
        return self.faulty.read(zone, self.own.read(zone, reading_degC, step_degC), step_degC)

    def air(self, air_degC: Array) -> Array:
        return self.faulty.air(self.own.air(air_degC))
