"""The plans for a device: take the room, or anything that was logged, from its level at rest to another.

Every plan starts from rest, with all readings still; what is switched is switched at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

_STEPS_K = (10.0, -10.0, 20.0, -20.0)
_BACK_K = (20.0, -20.0)
_PULSES_S = (1200.0, 3600.0)
_WARM_S = 3600.0
_USUAL = (0.02, 0.98)
"""Quantiles: a level that a signal was seen at for a while."""
NEVER, ALWAYS = float("inf"), -float("inf")
_S_PER_K, _UNDOING_S, _WAITING_S = 60.0, 3600.0, 3600.0


@dataclass(frozen=True)
class Drive:
    """A logged signal: where it is while nothing is done, and the levels that were seen besides."""

    column: str
    rest: float
    levels: tuple[float, ...]


@dataclass(frozen=True)
class Bench:
    """What can be set: the prescribed temperatures by column, in degC at rest, and the drives.

    ``heater`` is the drive, with its level, that warms the device most; None where nothing does.
    """

    temperatures_degC: Mapping[str, float]
    drives: tuple[Drive, ...]
    heater: tuple[str, float] | None

    @property
    def rest(self) -> dict[str, float]:
        """Every column's level while nothing is done."""
        return {**self.temperatures_degC, **{drive.column: drive.rest for drive in self.drives}}


@dataclass(frozen=True)
class Switch:
    """From ``at_s`` on, a column is at ``level``."""

    column: str
    at_s: float
    level: float


@dataclass(frozen=True)
class Plan:
    """Switches in the order of time; ``again_s`` is when what is suspected happens again.

    None leaves it as it is, ``NEVER`` undoes it for good, ``ALWAYS`` waits until it is there. ``undone``: it
    goes on, and is undone first.
    """

    switches: tuple[Switch, ...]
    again_s: float | None = None
    undone: bool = False

    @property
    def acts(self) -> int:
        """How many things are to be done."""
        return len(self.switches) + self.undone + (self.again_s is not None and self.again_s != NEVER)

    def preparation_s(self, bench: Bench) -> float:
        """What it costs beforehand: another room, and to undo what goes on."""
        ways_K = [
            abs(switch.level - bench.temperatures_degC[switch.column])
            for switch in self.switches
            if switch.column in bench.temperatures_degC
        ]
        waits = self.again_s == ALWAYS
        return _S_PER_K * max(ways_K, default=0.0) + _UNDOING_S * self.undone + _WAITING_S * waits

    def columns(self, bench: Bench, time_s: Array) -> dict[str, Array]:
        """Every column over ``time_s`` (N,)."""
        result = {name: np.full(len(time_s), level) for name, level in bench.rest.items()}
        for switch in self.switches:
            result[switch.column][time_s >= switch.at_s] = switch.level
        return result

    def happens(self, time_s: Array) -> Array | None:
        """1 where what is suspected is made to happen, (N,); None where it is left as it is."""
        return None if self.again_s is None else (time_s >= self.again_s).astype(float)


def bench_of(views: Sequence[View], signals: Sequence[str]) -> Bench:
    """What can be set on the device of these records; ``signals`` are those that something may go with."""
    plant = views[0].plant
    inputs = plant.circuit.inputs
    rows = {name: np.concatenate([view.record.inputs[at] for view in views]) for at, name in enumerate(inputs)}
    for name in signals:
        rows.setdefault(name, np.concatenate([view.signal(name) for view in views]))
    temperatures = {name: float(round(np.median(row))) for name, row in rows.items() if name.endswith("_degC")}
    drives = tuple(_drive(name, row) for name, row in rows.items() if name not in temperatures)
    gains = -np.linalg.pinv(plant.A) @ plant.B
    rises = {
        (drive.column, level): float(np.max(gains[:, inputs.index(drive.column)] * (level - drive.rest)))
        for drive in drives
        if drive.column in inputs
        for level in drive.levels
    }
    heater = max(rises, key=lambda each: rises[each], default=None)
    return Bench(temperatures, drives, heater if heater is not None and rises[heater] > 0 else None)


def _drive(column: str, row: Array) -> Drive:
    seen = np.quantile(row, _USUAL)
    low, high = (float(f"{each:.2g}") for each in (seen if np.ptp(seen) > 0 else (row.min(), row.max())))
    # at rest a drive does as little as was seen
    rest = min(max(0.0, low), high)
    return Drive(column, rest, tuple(level for level in (high, low) if level != rest))


class Intervention(Enum):
    """What is to be done about what is suspected to have happened."""

    LEFT = 0
    """Nothing: it goes on, or it goes with what was logged."""
    REPEATED = 1
    """It is over, and is done again on purpose."""
    UNDONE = 2
    """It goes on, is undone, and may be done again."""
    AWAITED = 3
    """It is over, and cannot be done on purpose."""


_AGAIN_S = {
    Intervention.LEFT: (),
    Intervention.REPEATED: (0.0,),
    Intervention.UNDONE: (NEVER, 0.0),
    Intervention.AWAITED: (ALWAYS,),
}


def plans(bench: Bench, intervention: Intervention) -> list[Plan]:
    """All that can be done, the simplest first."""
    sets = [tuple(switches) for switches in _switches(bench)]
    result = [Plan(switches) for switches in sets]
    undone = intervention is Intervention.UNDONE
    result += [Plan(switches, moment, undone) for moment in _AGAIN_S[intervention] for switches in sets]
    if 0.0 in _AGAIN_S[intervention] and bench.heater is not None:
        result.append(Plan((Switch(bench.heater[0], 0.0, bench.heater[1]),), _WARM_S, undone))
    return sorted(result, key=lambda each: each.acts)


def _switches(bench: Bench) -> Iterator[list[Switch]]:
    yield []
    temperatures = bench.temperatures_degC.items()
    levels = [(drive, level) for drive in bench.drives for level in drive.levels]
    for drive, level in levels:
        yield [Switch(drive.column, 0.0, level)]
    for name, rest_degC in temperatures:
        yield from ([Switch(name, 0.0, rest_degC + step)] for step in _STEPS_K)
    for drive, level in levels:
        for pulse_s in _PULSES_S:
            yield [Switch(drive.column, 0.0, level), Switch(drive.column, pulse_s, drive.rest)]
    for name, rest_degC in temperatures:
        yield from ([Switch(name, 0.0, rest_degC + step), Switch(name, _WARM_S, rest_degC)] for step in _BACK_K)
    if bench.heater is not None:
        yield from _warm(bench, bench.heater)


def _warm(bench: Bench, heater: tuple[str, float]) -> Iterator[list[Switch]]:
    """The same while the device is warm, or warms up."""
    warm = Switch(heater[0], 0.0, heater[1])
    others = chain(
        ((drive.column, level) for drive in bench.drives if drive.column != heater[0] for level in drive.levels),
        ((name, rest + step) for name, rest in bench.temperatures_degC.items() for step in _BACK_K),
    )
    for column, level in others:
        for at_s in (0.0, _WARM_S):
            yield [warm, Switch(column, at_s, level)]
