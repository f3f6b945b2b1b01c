"""A fleet is drawn: units within their tolerances, bare or in a case, each using the device in its own way.

Usage: each unit begins the scenario at a step of its own and goes round; before, it was settled at that step's
temperature. The same seed gives the same unit, however many others there are.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.additions import Added, together
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.hidden import Acting, Hidden
from ambient_trainer.simulator.run import Driven, Run, integrate, prepare, stream
from ambient_trainer.simulator.scenario import Scenario, Step, load_scenario
from ambient_trainer.simulator.simulate import Instruments, setting_of, trace_of
from ambient_trainer.simulator.text import hidden_text, parse_hidden
from ambient_trainer.simulator.unit import Unit, case_of, drawn

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
        used = [_in_use(plan, device, scenario, number, hidden.get(number, ())) for number in numbers]
        done = integrate([each.run for each in used], plan.period_s, None, [each.added for each in used])
        yield from (each.logged(driven) for each, driven in zip(used, done))
        if progress:
            progress(numbers[-1], plan.count)


@dataclass(frozen=True)
class _InUse:
    """A unit in the run that it goes through."""

    plan: FleetPlan
    unit: Unit
    cased: bool
    seed: int
    run: Run
    acting: Sequence[Acting]

    @property
    def added(self) -> Added:
        parts = [each.part(10 + index) for index, each in enumerate(self.acting)]
        return together([*parts, *([case_of(self.unit, self.run, self.plan.period_s, self.seed)] * self.cased)])

    def logged(self, driven: Driven) -> FleetUnit:
        unit, name, case = self.unit, f"u{self.unit.number:05d}", CASE_ON if self.cased else CASE_OFF
        instruments = Instruments(unit.gains, self.acting)
        trace = trace_of(driven, self.plan.scenario, self.seed, self.plan.period_s, unit.zones, instruments)
        effects = [each.hidden for each in self.acting]
        truth = {
            "unit": name,
            "case": case,
            "offset_K": {zone.name: zone.offset_degC for zone in unit.zones},
            "gain": dict(unit.gains),
            "hidden": [{"text": hidden_text(each), "cause": each.cause, "location": each.location} for each in effects],
        }
        return FleetUnit(name, replace(trace, path=name), case, truth)


def _in_use(plan: FleetPlan, device: Device, scenario: Scenario, number: int, hidden: Sequence[Hidden]) -> _InUse:
    unit = drawn(number, plan.seed, device.main_zones, device)
    cased = stream(plan.seed, f"unit {number} cased").uniform() < plan.cased
    seed = _RUNS_APART * (plan.seed + 1) + 10_000_019 * plan.run + number
    run = prepare(_usage(scenario, seed, plan.minutes), seed, plan.period_s, unit.phone)
    setting = setting_of(run, plan.period_s)
    own = [partial(stream, seed, f"hidden {each.cause} {each.location}") for each in hidden]
    return _InUse(plan, unit, cased, seed, run, [Acting(each, setting, random) for each, random in zip(hidden, own)])


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
