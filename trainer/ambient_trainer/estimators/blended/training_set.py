"""The training set of the filters: the log, and synthetic runs of the forward circuit.

Idle runs put the device into ambients that the log did not visit in that order. Runs with a pattern hold unmeasured
heat. The circuit's own residuals are sensor signals that no ambient explains: their target is zero.
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
from ambient_trainer.estimators.blended.synthetic import (
    AmbientModel,
    Workload,
    synthetic_ambient,
    synthetic_heat,
    synthetic_work,
)

Array = NDArray[np.float64]

_PASSES = 6
_LOGGED_EVERY_S = 7.0
_SYNTHETIC_EVERY_S = 11.0
"""How far apart samples lie that are compared with the target: neighbours repeat each other."""


class TrainingRun(NamedTuple):
    """Sensor signals and the filter's target."""

    sensors_degC: Array
    """(m, N)"""
    target_degC: Array
    """(N,)"""
    stride: int
    """Every so many-th sample is compared."""
    absolute: bool
    """Whether the filter's offset counts: not where the signals are differences."""

    def without(self, sensor: int) -> TrainingRun:
        """The run of a filter that lacks the sensor of this index."""
        return self._replace(sensors_degC=np.delete(self.sensors_degC, sensor, axis=0))


TrainingSet = Mapping[str, Sequence[TrainingRun]]
"""Runs by the name that the recipe weighs them by."""


@dataclass(frozen=True)
class TrainingSetDesign:
    """What runs are simulated from; the circuit runs at ``period_s``, the filter ``finer`` times as often."""

    recipe: Recipe
    forward: Forward
    fit: ForwardFit
    ambient: AmbientModel
    workload: Workload
    period_s: float
    finer: int
    seed: int
    draw: int = 0
    """The runs of another number are drawn anew."""

    def runs(self, records: Sequence[Record]) -> dict[str, list[TrainingRun]]:
        """Every run of the recipe, ``records`` being the log at the filter's period."""
        every = self._stride(_LOGGED_EVERY_S)
        return {
            LOGGED: [TrainingRun(each.sensors_degC, each.ambient_degC, every, True) for each in records],
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
        return (np.random.default_rng([self.seed, kind, run, self.draw]) for run in range(runs))

    def _count(self, hours: float) -> int:
        return round(hours * 3600 / self.period_s)

    def _idle(self, random: np.random.Generator) -> TrainingRun:
        count = self._count(self.recipe.made_up.idle.hours)
        ambient = synthetic_ambient(self.ambient, self.recipe.made_up, count, random)
        return self._run(ambient, synthetic_work(self.workload, self.recipe.made_up, count, self.period_s, random))

    def _pattern(self, kind: int, pattern: Pattern) -> Iterator[TrainingRun]:
        unlogged = self.recipe.unlogged
        runs = unlogged.runs * len(pattern.watts)
        count = self._count(unlogged.hours)
        for run, random in enumerate(self._draws(kind, runs)):
            ambient = synthetic_ambient(self.ambient, self.recipe.made_up, count, random)
            work = np.repeat(self.workload.idle_W[:, None], count, axis=1)
            if not pattern.alone:
                work = synthetic_work(self.workload, self.recipe.made_up, count, self.period_s, random)
            watts = pattern.watts[run % len(pattern.watts)]
            heat = synthetic_heat(watts, unlogged, self.forward.nodes, count, self.period_s, random)
            yield self._run(ambient, work, heat)

    def _run(self, ambient: Array, work: Array, unlogged: Array | float = 0.0) -> TrainingRun:
        heat = self.forward.heat_W(self.fit.shares, *work) + unlogged
        sensors = simulate(self.fit.plant, self.recipe.loss, ambient, heat, self.period_s, _PASSES)
        return TrainingRun(self._finer(sensors), self._finer(ambient[None])[0], self._stride(_SYNTHETIC_EVERY_S), True)

    def _residuals(self, records: Sequence[Record]) -> Iterator[TrainingRun]:
        for record in records:
            coarse = record.every(self.finer)
            heat = self.forward.heat_W(self.fit.shares, coarse.measured_W, coarse.shared_W)
            simulated = simulate(self.fit.plant, self.recipe.loss, coarse.ambient_degC, heat, self.period_s, _PASSES)
            rest = self._finer(coarse.sensors_degC - simulated)
            yield TrainingRun(rest, np.zeros(rest.shape[1]), self._stride(_SYNTHETIC_EVERY_S), False)

    def _finer(self, rows: Array) -> Array:
        """The rows at the filter's period, straight between the circuit's samples."""
        coarse = np.arange(rows.shape[1])
        fine = np.arange(rows.shape[1] * self.finer) / self.finer
        return np.vstack([np.interp(fine, coarse, row) for row in rows])
