"""The plan and the reading by which models first differ by three standard deviations of the residual.

The residual is correlated in time, so that waiting does not average it out: the deviation itself counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.causes import kind_of
from ambient_trainer.diagnosis.experiment.plan import Bench, Plan
from ambient_trainer.diagnosis.experiment.simulate import Course, Predicted, predicted
from ambient_trainer.diagnosis.model import Effect, Model
from ambient_trainer.estimation.noise import Noise

Array = NDArray[np.float64]

_STEPS = 720
_SIGMAS = 3.0
_FITTING_S = 3600.0
"""What a second thermometer costs; if the sensors that are there do as well, they are taken."""
_NO_MATTER_S, _NO_MATTER_SHARE, _ABOUT_ALL = 60.0, 0.1, 0.98
_ROUND_S = 60.0


@dataclass(frozen=True)
class Hypothesis:
    """A model and the effect in it that is in question; None for the model without any.

    ``repeats`` where that effect comes and goes with what an experiment makes happen.
    """

    model: Model
    effect: Effect | None
    repeats: bool = False


@dataclass(frozen=True)
class Limits:
    """When the records began and ended, how long an experiment may last, the temperatures that it may reach."""

    since_s: float
    now_s: float
    longest_s: float
    bounds_degC: tuple[float, float]
    noise: Noise


@dataclass(frozen=True)
class Difference:
    """What to read, when, and the predictions of one model and of the ``others`` that it is distinguished from.

    ``beside`` compares with a second thermometer at the sensor's place. ``crossing_s`` is when the one first differs by
    ``three_sigma_degC`` from all of them, None where it never does, ``reading_s`` a moment from then on to look; both
    are counted from the first switch, and None is rest, before any.
    """

    plan: Plan
    sensor: int
    beside: bool
    crossing_s: float | None
    reading_s: float | None
    predicted_degC: tuple[float, ...]
    """By the one, then by each of ``others``."""
    three_sigma_degC: float
    others: tuple[int, ...] = (0,)
    """Indices of the others; where it is distinguished from none, the one that differs most."""


def largest_difference(
    one: Hypothesis, others: Sequence[Hypothesis], plans: Sequence[Plan], bench: Bench, facts: Limits
) -> Difference:
    """Of all plans the one whose reading distinguishes ``one`` from most of ``others`` soonest, or, if none does, best.

    Where one reading does not distinguish all, those that come first are preferred.
    """
    every = [one, *others]
    step_s = facts.longest_s / _STEPS
    # the first sample is rest, before anything is switched
    lead = 1 + math.ceil(_reach_s(every) / step_s)
    time_s: Array = step_s * np.arange(-lead, _STEPS + 1, dtype=float)
    courses = [Course(plan.columns(bench, time_s), plan.happens(time_s)) for plan in plans]
    found = [
        predicted(each.model, each.effect if each.repeats else None, courses, facts.now_s + time_s, facts.since_s)
        for each in every
    ]
    doubtful = sorted({sensor for each in every if each.effect for sensor in each.effect.sensors})
    looks = _Readings.of(found, doubtful, facts)
    preparation_s = np.array([plan.preparation_s(bench) for plan in plans])
    return _best(looks, plans, preparation_s, time_s)


def _reach_s(every: Sequence[Hypothesis]) -> float:
    """How far a wrong clock reaches back: what the reference logs later was there before."""
    effects = [effect for each in every for effect in each.model.effects]
    shapes = [each.candidate.shape for each in effects if kind_of(each.candidate.cause).shifts_clock]
    return max((abs(shape) for shape in shapes if shape is not None), default=0.0)


@dataclass(frozen=True)
class _Readings:
    """What can be looked at, o things: every sensor, then the doubtful ones beside a second thermometer.

    ``values`` (1 + K, E, o, N) is what the one and K others predict, ``three_sigma`` (o,) what it must differ by, and
    ``bearable`` (E, 1, N) whether the device has stayed where it may be.
    """

    values: Array
    three_sigma: Array
    bearable: NDArray[np.bool_]
    sensors: list[int]
    beside: list[bool]

    @staticmethod
    def of(found: Sequence[Predicted], doubtful: list[int], facts: Limits) -> _Readings:
        readings = np.array([each.readings_degC for each in found])
        errors = np.array([each.errors_degC for each in found])[:, :, doubtful]
        low, high = facts.bounds_degC
        with np.errstate(invalid="ignore"):
            inside = ((readings > low) & (readings < high)).all(axis=(0, 2))
        sigma = facts.noise.deviation_degC
        count = len(sigma)
        return _Readings(
            np.concatenate([readings, errors], axis=2),
            # the second thermometer is no better than the first
            _SIGMAS * np.concatenate([sigma, math.sqrt(2.0) * sigma[doubtful]]),
            np.logical_and.accumulate(inside, axis=1)[:, None],
            [*range(count), *doubtful],
            [False] * count + [True] * len(doubtful),
        )

    def distinguished(self) -> tuple[tuple[int, ...], Array]:
        """The others that one reading distinguishes, and the least difference to them in units of three sigma.

        That is (E, o, N), zero where the device cannot bear the plan, and below one where no reading distinguishes any.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            ratios = np.abs(self.values[0] - self.values[1:]) / self.three_sigma[:, None]
        ratios = np.where(self.bearable, ratios, 0.0)
        for size in range(len(ratios), 0, -1):
            for others in combinations(range(len(ratios)), size):
                least = ratios[list(others)].min(axis=0)
                if (least >= 1.0).any():
                    return others, least
        most = int(ratios.max(axis=(1, 2, 3)).argmax())
        return (most,), ratios[most]


def _best(looks: _Readings, plans: Sequence[Plan], preparation_s: Array, time_s: Array) -> Difference:
    others, ratio = looks.distinguished()
    over = ratio >= 1.0
    if not over.any():
        most = ratio >= _ABOUT_ALL * ratio.max()
        plan = int(np.flatnonzero(most.any(axis=(1, 2)))[0])
        index = int(most[plan].any(axis=0).argmax())
        look = int(ratio[plan, :, index].argmax())
        return _difference(looks, plans, time_s, (plan, look, index), others, None)
    first = over.argmax(axis=2)
    crossing_s = np.where(over.any(axis=2), _interpolated(ratio, first, time_s), np.inf)
    cost_s = crossing_s + preparation_s[:, None] + _FITTING_S * np.array(looks.beside)
    # plans come with the simplest first
    plan = int(np.flatnonzero((cost_s <= _about(cost_s.min())).any(axis=1))[0])
    soonest = np.flatnonzero(cost_s[plan] <= cost_s[plan].min() + 1.0)
    look = int(max(soonest, key=lambda each: ratio[plan, each, first[plan, each]]))
    index = _rounded(over[plan, look], time_s, int(first[plan, look]))
    return _difference(looks, plans, time_s, (plan, look, index), others, crossing_s[plan, look])


def _about(cost_s: float) -> float:
    """What takes no longer than that is preferred if it is simpler."""
    return cost_s + max(_NO_MATTER_S, _NO_MATTER_SHARE * abs(cost_s))


def _interpolated(ratio: Array, first: NDArray[np.intp], time_s: Array) -> Array:
    """When ``ratio`` (E, o, N) passes one between the sample before ``first`` (E, o) and that one."""
    after = np.take_along_axis(ratio, first[:, :, None], axis=2)[:, :, 0]
    before = np.take_along_axis(ratio, np.maximum(first - 1, 0)[:, :, None], axis=2)[:, :, 0]
    rising = (first > 0) & (after > before)
    share = np.where(rising, (1.0 - before) / np.where(rising, after - before, 1.0), 1.0)
    return np.asarray(time_s[first] - (1.0 - share) * (time_s[1] - time_s[0]) * rising)


def _rounded(over: NDArray[np.bool_], time_s: Array, first: int) -> int:
    """A sample at a whole minute from ``first`` on, where they still differ then."""
    if first == 0:
        return 0
    step_s = time_s[1] - time_s[0]
    whole_s = _ROUND_S * math.ceil((time_s[first] - 1e-6) / _ROUND_S)
    later = first + round((whole_s - time_s[first]) / step_s)
    return later if later < len(time_s) and over[first : later + 1].all() else first


def _difference(
    looks: _Readings,
    plans: Sequence[Plan],
    time_s: Array,
    place: tuple[int, int, int],
    others: tuple[int, ...],
    crossing_s: float | None,
) -> Difference:
    plan, look, index = place
    values = looks.values[:, plan, look, index]
    return Difference(
        plans[plan],
        looks.sensors[look],
        looks.beside[look],
        None if crossing_s is None else float(crossing_s),
        None if index == 0 else float(time_s[index]),
        (float(values[0]), *(float(values[1 + other]) for other in others)),
        float(looks.three_sigma[look]),
        others,
    )
