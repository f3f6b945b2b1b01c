"""What filters are taught by: the log, and what the forward circuit makes up beside it.

Idle runs put the device into ambients that the log never reached in that order; runs with a pattern hold heat that no
signal tells of; the circuit's own residuals are what sensors say that no ambient explains, and the right answer to them
is nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.estimators.blended.forward_fit import Forward, ForwardFit, Record
from ambient_trainer.estimators.blended.nonlinear_loss import simulate
from ambient_trainer.estimators.blended.recipe import IDLE, LOGGED, RESIDUAL, Pattern, Recipe
from ambient_trainer.estimators.blended.synthetic_ambient import Weather, made_up_ambient
from ambient_trainer.estimators.blended.synthetic_load import Workload, made_up_heat, made_up_work

Array = NDArray[np.float64]

_PASSES = 6
_LOGGED_EVERY_S = 7.0
_MADE_UP_EVERY_S = 11.0
"""How far apart samples lie that are compared with the target: neighbours say the same."""


class Lesson(NamedTuple):
    """What the sensors read and what the filter is to make of it."""

    sensors_degC: Array
    """(m, N)"""
    target_degC: Array
    """(N,)"""
    stride: int
    """Each so many-th sample is compared."""
    absolute: bool
    """Whether the filter's offset belongs to the answer: not where the sensors' are differences."""

    def without(self, sensor: int) -> Lesson:
        """The lesson of a filter that lacks the sensor of this index."""
        return self._replace(sensors_degC=np.delete(self.sensors_degC, sensor, axis=0))


Lessons = Mapping[str, Sequence[Lesson]]
"""By the name that the recipe weighs them by."""


@dataclass(frozen=True)
class Classroom:
    """All that lessons are made of; the circuit runs at ``period_s``, the filter ``finer`` times as often."""

    recipe: Recipe
    forward: Forward
    fit: ForwardFit
    weather: Weather
    workload: Workload
    period_s: float
    finer: int
    seed: int
    term: int = 0
    """Another term's lessons are drawn anew."""

    def lessons(self, records: Sequence[Record]) -> dict[str, list[Lesson]]:
        """Every lesson of the recipe, ``records`` being the log at the filter's period."""
        return {
            LOGGED: [
                Lesson(each.sensors_degC, each.ambient_degC, self._stride(_LOGGED_EVERY_S), True) for each in records
            ],
            IDLE: [self._idle(random) for random in self._draws(0, self.recipe.made_up.idle.runs)],
            RESIDUAL: list(self._residuals(records)),
            **{
                name: list(self._pattern(index + 1, each))
                for index, (name, each) in enumerate(self.recipe.unlogged.patterns.items())
            },
        }

    def _stride(self, seconds: float) -> int:
        return max(1, round(seconds * self.finer / self.period_s))

    def _draws(self, kind: int, runs: int) -> Iterator[np.random.Generator]:
        return (np.random.default_rng([self.seed, kind, run, self.term]) for run in range(runs))

    def _count(self, hours: float) -> int:
        return round(hours * 3600 / self.period_s)

    def _idle(self, random: np.random.Generator) -> Lesson:
        count = self._count(self.recipe.made_up.idle.hours)
        ambient = made_up_ambient(self.weather, self.recipe.made_up, count, random)
        return self._run(ambient, made_up_work(self.workload, self.recipe.made_up, count, self.period_s, random))

    def _pattern(self, kind: int, pattern: Pattern) -> Iterator[Lesson]:
        unlogged = self.recipe.unlogged
        runs = unlogged.runs * len(pattern.watts)
        count = self._count(unlogged.hours)
        for run, random in enumerate(self._draws(kind, runs)):
            ambient = made_up_ambient(self.weather, self.recipe.made_up, count, random)
            work = np.repeat(self.workload.idle_W[:, None], count, axis=1)
            if not pattern.alone:
                work = made_up_work(self.workload, self.recipe.made_up, count, self.period_s, random)
            watts = pattern.watts[run % len(pattern.watts)]
            heat = made_up_heat(watts, unlogged, self.forward.nodes, count, self.period_s, random)
            yield self._run(ambient, work, heat)

    def _run(self, ambient: Array, work: Array, unlogged: Array | float = 0.0) -> Lesson:
        heat = self.forward.heat_W(self.fit.shares, *work) + unlogged
        sensors = simulate(self.fit.plant, self.recipe.loss, ambient, heat, self.period_s, _PASSES)
        return Lesson(self._finer(sensors), self._finer(ambient[None])[0], self._stride(_MADE_UP_EVERY_S), True)

    def _residuals(self, records: Sequence[Record]) -> Iterator[Lesson]:
        for record in records:
            coarse = record.every(self.finer)
            heat = self.forward.heat_W(self.fit.shares, coarse.measured_W, coarse.shared_W)
            said = simulate(self.fit.plant, self.recipe.loss, coarse.ambient_degC, heat, self.period_s, _PASSES)
            rest = self._finer(coarse.sensors_degC - said)
            yield Lesson(rest, np.zeros(rest.shape[1]), self._stride(_MADE_UP_EVERY_S), False)

    def _finer(self, rows: Array) -> Array:
        """The rows at the filter's period, straight between the circuit's samples."""
        coarse = np.arange(rows.shape[1])
        fine = np.arange(rows.shape[1] * self.finer) / self.finer
        return np.vstack([np.interp(fine, coarse, row) for row in rows])
