"""The training set of the filters: the log, and synthetic runs of the forward circuit.

Idle runs visit other ambients, runs with a pattern hold unmeasured heat, and the circuit's own residuals are signals
that no ambient explains: their target is zero. A synthetic ambient goes through random set points at the log's rate of
change, with the swing and noise of the log's calmest hour; the load is episodes of logged work. Synthetic readings have
the resolution of the logged ones.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from ambient_model.faults import refuse
from ambient_trainer.data import Array, Segment, rounded
from ambient_trainer.estimators.blended.forward import Plant, PlantRecord
from ambient_trainer.estimators.blended.recipe import IDLE, LOGGED, RESIDUAL, Recipe, Synthetic, Work
from ambient_trainer.lti.lag import low_pass

_CALM_S = 3600.0
_SMOOTHED_S = 900.0
_SWING_PERIODS_S = np.geomspace(120.0, 1800.0, 200)
_STEEP_PERCENT = 99.5
_STEEP_OVER_S = 60.0


class AmbientModel(NamedTuple):
    """How an ambient changes: its rate to another set point, its swing, and noise of a first-order memory."""

    slope_K_s: float
    swing_K: float
    swing_period_s: float
    noise_K: float
    noise_memory: float
    period_s: float


def fit_ambient(ambients_degC: Sequence[Array], period_s: float, source: str) -> AmbientModel:
    """Fitted to ambients of N samples each; raises :class:`Refused` where none of them is an hour long."""
    window, minute = round(_CALM_S / period_s), max(1, round(_STEEP_OVER_S / period_s))
    long = [each for each in ambients_degC if len(each) > window]
    if not long:
        raise refuse(source, "", "no hour without a gap", "log longer: the ambient's own swing is fitted to one")
    # in minutes of the whole log, most of which are calm
    steps = np.concatenate([np.abs(np.diff(each[::minute])) for each in long])
    calm = _calmest(long, window, period_s)
    calm = calm - calm.mean()
    swing_period_s, swing, rest = _strongest(calm, period_s)
    slope_K_s = float(np.percentile(steps, _STEEP_PERCENT)) / (minute * period_s)
    autoregression = float(np.clip(float(rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-12), 0.0, 0.999))
    return AmbientModel(slope_K_s, swing, swing_period_s, float(rest.std()), autoregression, period_s)


def synthetic_ambient(ambient: AmbientModel, rule: Synthetic, count: int, random: np.random.Generator) -> Array:
    """An ambient of ``count`` samples, (N,), through set points that the rule allows."""
    T = ambient.period_s
    set_points: list[float] = []
    while len(set_points) < count:
        stay = max(1, round(random.uniform(*rule.stay_min) * 60.0 / T))
        set_points += [random.uniform(*rule.ambient_degC)] * stay
    step, first = ambient.slope_K_s * T, set_points[0]
    moves = itertools.accumulate(set_points, lambda now, aim: now + min(max(aim - now, -step), step), initial=first)
    settled = low_pass(np.fromiter(moves, float, count), rule.settling_s, T, first)
    phase = random.uniform(0.0, 2.0 * math.pi)
    swing = ambient.swing_K * np.sin(2.0 * math.pi * T * np.arange(count) / ambient.swing_period_s + phase)
    white = random.standard_normal(count)
    white[1:] *= math.sqrt(1.0 - ambient.noise_memory**2)
    return np.asarray(settled + swing + ambient.noise_K * lfilter([1.0], [1.0, -ambient.noise_memory], white))


def _calmest(ambients_degC: Sequence[Array], window: int, period_s: float) -> Array:
    """The hour whose average over a quarter of an hour moves least."""
    smoothed = max(1, round(_SMOOTHED_S / period_s))
    stride = max(1, round(300.0 / period_s))
    hours = []
    for each in ambients_degC:
        mean = np.convolve(each, np.full(smoothed, 1 / smoothed), "valid")
        for start in range(0, len(each) - window, stride):
            hours.append((np.ptp(mean[start : start + window - smoothed + 1]), each[start : start + window]))
    return min(hours, key=lambda each: each[0])[1]


def _strongest(values: Array, period_s: float) -> tuple[float, float, Array]:
    """Period (s), amplitude and rest of the sinusoid that explains most of ``values``."""
    time_s = period_s * np.arange(len(values))
    found = []
    for swing_period_s in _SWING_PERIODS_S.tolist():
        angle = 2.0 * math.pi * time_s / swing_period_s
        table = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
        weights = np.linalg.lstsq(table, values, rcond=None)[0]
        rest = values - table @ weights
        found.append((swing_period_s, float(np.hypot(weights[0], weights[1])), rest))
    return min(found, key=lambda each: float(each[2] @ each[2]))


_LEAST_EFFORT = 0.25
_LEAST_PAUSE_MIN = 5.0


class Workload(NamedTuple):
    """The heat of idling (measured, shared), in W, and that of each episode of work in the log, (2, N)."""

    idle_W: Array
    episodes_W: tuple[Array, ...]


def fit_workload(records: Sequence[PlantRecord], work: Work, source: str) -> Workload:
    """The heat of idling and of each stretch of work; raises :class:`Refused` where one of them is missing."""
    episodes, idle = [], []
    for record in records:
        heat = np.vstack([record.measured_W, record.shared_W])
        busy = record.work > work.busy_above
        idle.append(heat[:, ~busy])
        changes = np.flatnonzero(np.diff(record.work)) + 1
        stretches = zip(np.split(heat, changes, axis=1), np.split(busy, changes))
        episodes += [stretch for stretch, is_busy in stretches if is_busy[0]]
    idling = np.concatenate(idle, axis=1)
    if not episodes or not idling.shape[1]:
        missing = "never" if not episodes else "always"
        hint = "log a run with work and with pauses, or name another signal under 'work'"
        raise refuse(source, f"column {work.signal}", f"is {missing} above {work.busy_above:g}", hint)
    return Workload(idling.mean(axis=1), tuple(episodes))


def _drawn(minutes: tuple[float, float], period_s: float, random: np.random.Generator) -> int:
    """A length in samples: at least the first, on average the second."""
    low, mean = minutes
    return max(1, round((low + random.exponential(mean - low)) * 60 / period_s))


_PASSES = 6

TrainingSet = Mapping[str, Sequence[Segment]]
"""Runs by the name that the recipe weighs them by: the sensors, and what a filter should make of them."""


@dataclass(frozen=True)
class TrainingSetDesign:
    """What runs are simulated from; the filter runs at ``period_s``, the circuit once in ``coarser`` of these.

    ``steps_degC`` are the sensors' resolutions; the runs of another ``draw`` are drawn anew.
    """

    recipe: Recipe
    plant: Plant
    ambient: AmbientModel
    workload: Workload
    period_s: float
    coarser: int
    seed: int
    steps_degC: tuple[float, ...]
    draw: int = 0

    def runs(self, records: Sequence[PlantRecord]) -> dict[str, list[Segment]]:
        """Every run of the recipe, ``records`` being the log at the filter's period."""
        idle, unlogged = self.recipe.made_up.idle, self.recipe.unlogged
        coarse = [each.every(self.coarser) for each in records]
        rests = map(self._finer, self.plant.misfits(coarse, self.ambient.period_s, _PASSES))
        found = {
            LOGGED: [Segment(self.period_s, each.sensors_degC, each.ambient_degC[None]) for each in records],
            IDLE: [self._run(random, idle.hours) for random in self._draws(0, idle.runs)],
            RESIDUAL: [Segment(self.period_s, each, np.zeros((1, each.shape[1]))) for each in rests],
        }
        for kind, (name, pattern) in enumerate(unlogged.patterns.items(), start=1):
            draws = self._draws(kind, unlogged.runs * len(pattern.watts))
            variants = zip(draws, itertools.cycle(pattern.watts))
            found[name] = [self._run(random, unlogged.hours, watts, pattern.alone) for random, watts in variants]
        return found

    def _draws(self, kind: int, runs: int) -> Iterator[np.random.Generator]:
        return (np.random.default_rng([self.seed, kind, run, self.draw]) for run in range(runs))

    def _run(
        self, random: np.random.Generator, hours: float, watts: Mapping[str, float] | None = None, alone: bool = False
    ) -> Segment:
        """A synthetic run with unmeasured heat of ``watts``, on a device that does nothing else where ``alone``."""
        T = self.ambient.period_s
        count = round(hours * 3600 / T)
        ambient = synthetic_ambient(self.ambient, self.recipe.made_up, count, random)
        work = np.repeat(self.workload.idle_W[:, None], count, axis=1) if alone else self._work_W(count, random)
        unlogged = self._unlogged_W(watts or {}, count, random)
        sensors = self.plant.readings_degC(ambient, self.plant.heat_W(*work) + unlogged, T, _PASSES)
        readings = np.vstack([rounded(*each) for each in zip(self._finer(sensors), self.steps_degC)])
        return Segment(self.period_s, readings, self._finer(ambient[None]))

    def _work_W(self, count: int, random: np.random.Generator) -> Array:
        """The heat (measured, shared) of a device that works now and then, (2, count).

        An episode of the log, in half of the cases weakened, goes on as it ended where it is too short.
        """
        (idle_W, episodes_W), rule, period_s = self.workload, self.recipe.made_up, self.ambient.period_s
        heat = np.repeat(idle_W[:, None], count, axis=1)
        mean_min = sum(rule.episode_min) / 2
        pause_min = mean_min * (1 - rule.busy) / rule.busy
        # every run holds some work
        at = round(random.uniform(*rule.episode_min) * 60 / period_s)
        while at < count:
            episode = episodes_W[random.integers(len(episodes_W))]
            effort = random.uniform(_LEAST_EFFORT, 1.0) if random.random() < 0.5 else 1.0
            length = min(round(random.uniform(*rule.episode_min) * 60 / period_s), count - at)
            kept = np.minimum(np.arange(length), episode.shape[1] - 1)
            heat[:, at : at + length] += effort * (episode[:, kept] - idle_W[:, None])
            at += length + round((_LEAST_PAUSE_MIN + random.exponential(pause_min - _LEAST_PAUSE_MIN)) * 60 / period_s)
        return heat

    def _unlogged_W(self, watts: Mapping[str, float], count: int, random: np.random.Generator) -> Array:
        """Episodes of ``watts``, (n, count), each scaled by a log-normal factor and each node by another."""
        nodes, rule, period_s = self.plant.nodes, self.recipe.unlogged, self.ambient.period_s
        heat = np.zeros((len(nodes), count))
        at = round(random.uniform(0.0, rule.pause_min[1]) * 60 / period_s)
        while at < count:
            length = _drawn(rule.episode_min, period_s, random)
            scale = np.exp(rule.log_deviation * random.standard_normal())
            for node, watt in watts.items():
                # so that the two factors together have a mean of 1
                own = np.exp(rule.log_deviation * random.standard_normal() - rule.log_deviation**2)
                heat[nodes[node], at : at + length] += watt * scale * own
            at += length + _drawn(rule.pause_min, period_s, random)
        return heat

    def _finer(self, rows: Array) -> Array:
        """The rows at the filter's period, straight between the circuit's samples."""
        coarse = np.arange(rows.shape[1])
        fine = np.arange(rows.shape[1] * self.coarser) / self.coarser
        return np.vstack([np.interp(fine, coarse, row) for row in rows])
