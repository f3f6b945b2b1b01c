"""The load of synthetic runs: episodes of logged work, and unmeasured heat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_trainer.estimators.blended.forward_fit import Record
from ambient_trainer.estimators.blended.recipe import Synthetic, Unmeasured, Work

Array = NDArray[np.float64]

_LEAST_EFFORT = 0.25
_LEAST_PAUSE_MIN = 5.0


@dataclass(frozen=True)
class Workload:
    """The heat of idling (measured, shared), in W, and that of each episode of work in the log, (2, N)."""

    idle_W: Array
    episodes_W: tuple[Array, ...]


def fit_workload(records: Sequence[Record], work: Work, source: str) -> Workload:
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
        mend = "log a run with work and with pauses, or name another signal under 'work'"
        raise refuse(source, f"column {work.signal}", f"is {missing} above {work.busy_above:g}", mend)
    return Workload(idling.mean(axis=1), tuple(episodes))


def synthetic_work(
    workload: Workload, rule: Synthetic, count: int, period_s: float, random: np.random.Generator
) -> Array:
    """The heat (measured, shared) of a device that works now and then, (2, count) in W.

    An episode of the log, in half of the cases weakened, goes on as it ended where it is too short.
    """
    heat = np.repeat(workload.idle_W[:, None], count, axis=1)
    mean_min = sum(rule.episode_min) / 2
    pause_min = mean_min * (1 - rule.busy) / rule.busy
    # every run holds some work
    at = round(random.uniform(*rule.episode_min) * 60 / period_s)
    while at < count:
        episode = workload.episodes_W[random.integers(len(workload.episodes_W))]
        effort = random.uniform(_LEAST_EFFORT, 1.0) if random.random() < 0.5 else 1.0
        length = min(round(random.uniform(*rule.episode_min) * 60 / period_s), count - at)
        kept = np.minimum(np.arange(length), episode.shape[1] - 1)
        heat[:, at : at + length] += effort * (episode[:, kept] - workload.idle_W[:, None])
        at += length + round((_LEAST_PAUSE_MIN + random.exponential(pause_min - _LEAST_PAUSE_MIN)) * 60 / period_s)
    return heat


def synthetic_heat(
    watts: Mapping[str, float],
    rule: Unmeasured,
    nodes: Mapping[str, int],
    count: int,
    period_s: float,
    random: np.random.Generator,
) -> Array:
    """Episodes of ``watts`` into the nodes, (n, count), each scaled by a log-normal factor and each node by another."""
    heat = np.zeros((len(nodes), count))
    at = round(random.uniform(0.0, rule.pause_min[1]) * 60 / period_s)
    while at < count:
        length = _drawn(rule.episode_min, period_s, random)
        scale = np.exp(rule.log_spread * random.standard_normal())
        for node, watt in watts.items():
            # so that the two factors together have a mean of 1
            own = np.exp(rule.log_spread * random.standard_normal() - rule.log_spread**2)
            heat[nodes[node], at : at + length] += watt * scale * own
        at += length + _drawn(rule.pause_min, period_s, random)
    return heat


def _drawn(minutes: tuple[float, float], period_s: float, random: np.random.Generator) -> int:
    """A length in samples: at least the first, on average the second."""
    low, mean = minutes
    return max(1, round((low + random.exponential(mean - low)) * 60 / period_s))
