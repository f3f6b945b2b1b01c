"""The free filter over runs that do not all count the same: logged, simulated, or made of what physics demands.

- All sensors one degree up is the estimate one degree up: :func:`level`, a run in which every sensor shows one value.
- White noise of a sensor: :func:`impulses`, whose target is zero. What is left is the impulse response, whose square
  sum is the square of the noise gain.
- A slow offset of a sensor: :func:`offsets`, runs in which one sensor is off all the time, whose target is zero. What
  is left is its DC gain. A short log shows few levels, and large opposite gains would fit how far the sensors differ
  at these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.free_filter import FreeFilter

_STEADY = 8
"""Samples of a run at a constant level: as many as a filter's delays need."""
_IMPULSE = 300
"""Samples of an impulse response; what comes later is small and slow."""


class Run(NamedTuple):
    """A run, what it counts (the root of the weight of a squared error), and whether the filter's offset is in it."""

    segment: Segment
    weight: float
    absolute: bool


def weighted_filter(order: int, runs: Sequence[Run]) -> FreeFilter:
    """The free filter of order N over weighted runs."""
    segments = [Segment(s.period_s, weight * s.inputs, weight * s.outputs) for s, weight, _ in runs]
    return FreeFilter(order, segments, [each.weight * each.absolute for each in runs])


def level(period_s: float, inputs: int, weight: float) -> list[Run]:
    """The run in which all sensors read one."""
    target = np.where(np.arange(_STEADY) > 0, np.nan, 1.0)
    return [Run(Segment(period_s, np.ones((inputs, _STEADY)), target[None]), weight, False)]


def impulses(period_s: float, inputs: int, weight: float, longest: int = _IMPULSE) -> list[Run]:
    """A run an input, in which it reads one once; the first sample sets the equilibrium."""
    samples = min(_IMPULSE, longest)
    return _alone(period_s, inputs, np.append(0.0, np.eye(1, samples - 1)), weight)


def offsets(period_s: float, inputs: int, weight: float) -> list[Run]:
    """A run an input, in which it reads one and all others zero."""
    return _alone(period_s, inputs, np.ones(_STEADY), weight / np.sqrt(_STEADY))


def _alone(period_s: float, inputs: int, values: Array, weight: float) -> list[Run]:
    rows = np.eye(inputs)[:, :, None] * values
    return [Run(Segment(period_s, u, np.zeros((1, len(values)))), weight, False) for u in rows]
