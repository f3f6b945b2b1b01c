"""Runs are integrated together: many phones, each with its own scenario and weather, in one loop over arrays.

What is asked of phone and chamber changes at samples and holds until the next; the air moves in straight lines between
them.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.additions import Added, Additions
from ambient_trainer.simulator.chamber import ramped, wobble
from ambient_trainer.simulator.constants import NODES, Activity
from ambient_trainer.simulator.device import Chamber, Phone
from ambient_trainer.simulator.heat import SOC, Demand, HeatBalance, rk4_step
from ambient_trainer.simulator.scenario import Scenario

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
_Number = TypeVar("_Number", np.float64, np.intp)

LONGEST_STEP_S = 1.0
_LEAST_BURST = 0.1
_PROGRESS_EVERY = 500
_ACTIVITIES = tuple(Activity)


@dataclass(frozen=True)
class Run:
    """What a phone is put through: n samples, the first ``unrecorded`` of them before the recording.

    It starts from equilibrium with ``start_degC``, its first activity and no burst.
    """

    phone: Phone
    start_degC: float
    air_degC: Array
    activity: NDArray[np.intp]
    """Indices of ``Activity``."""
    burst: Array
    """What the SoC's demanded power is multiplied with."""
    unrecorded: int

    @property
    def samples(self) -> int:
        """n."""
        return len(self.air_degC)


@dataclass(frozen=True)
class Driven:
    """Node temperatures in degC, shape (n, nodes), of one run, with its drives, shape (n,)."""

    run: Run
    nodes_degC: Array
    soc_W: Array
    current_A: Array
    bodies_degC: Array
    """Of what is added to the phone, shape (n, bodies)."""


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Random numbers of their own for each purpose: one more zone changes none of the others."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def prepare(scenario: Scenario, seed: int, period_s: float, phone: Phone, chamber: Chamber) -> Run:
    """The air, the activities and the bursts of one run."""
    unrecorded = math.ceil(scenario.before_s / period_s - 1e-9)
    recorded = math.ceil(scenario.duration_s / period_s - 1e-9)
    time_s: Array = np.arange(-unrecorded, recorded, dtype=np.float64) * period_s
    set_point_degC, activity = schedule(scenario, time_s)
    count = len(time_s)
    air_degC = ramped(set_point_degC, period_s, chamber) + wobble(count, period_s, chamber, stream(seed, "wobble"))
    streaming = activity == _ACTIVITIES.index(Activity.STREAMING)
    burst = np.where(streaming, bursts(time_s, phone, stream(seed, "bursts")), 1.0)
    return Run(phone, float(set_point_degC[0]), air_degC, activity, burst, unrecorded)


def bursts(time_s: Array, phone: Phone, random: np.random.Generator) -> Array:
    """What the SoC's power is multiplied with while it streams: a buffer that is filled and emptied, never negative."""
    phase = random.uniform(0.0, 2.0 * math.pi)
    swing = math.sqrt(2.0) * np.sin(2.0 * math.pi / c.BURSTS_PERIOD_S * time_s + phase)
    return np.maximum(1.0 + phone.burst_frac * swing, _LEAST_BURST)


def schedule(scenario: Scenario, time_s: Array) -> tuple[Array, NDArray[np.intp]]:
    """The chamber's set point in degC and the activity's index, shape (n,), at each of ``time_s`` (0: recording)."""
    steps = (*scenario.before, *scenario.steps)
    ends_s = np.cumsum([60.0 * (step.duration_min or 0.0) for step in steps]) - scenario.before_s
    current = np.searchsorted(ends_s, time_s + 1e-9, side="right")
    set_points = np.array([step.chamber_degC for step in steps])
    activities = np.array([_ACTIVITIES.index(Activity(step.load[0]) if step.load else Activity.IDLE) for step in steps])
    return set_points[current], activities[current]


def integrate(
    runs: Sequence[Run], period_s: float, progress: Progress | None = None, added: Sequence[Added] = ()
) -> list[Driven]:
    """The runs' temperatures, sample by sample; the longest run sets the time it takes.

    ``added`` is what comes to each run's phone, or nothing for all of them.
    """
    balance = HeatBalance([run.phone for run in runs])
    additions = Additions(balance, added) if any(each.terms or each.links for each in added) else None
    count = max(run.samples for run in runs)
    air = _stacked([run.air_degC for run in runs], count)
    activity = _stacked([run.activity for run in runs], count)
    burst = _stacked([run.burst for run in runs], count)
    size = len(NODES)
    nodes = np.empty((count, len(runs), additions.width if additions else size))
    drives = np.empty((count, 2, len(runs)))
    start_degC = np.array([run.start_degC for run in runs])
    resting = balance.demand(activity[0], np.ones(len(runs)))
    state = balance.equilibrium(start_degC, resting)
    if additions:
        state = additions.start(state, start_degC, resting)
    for k in range(count):
        demand = balance.demand(activity[k], burst[k])
        nodes[k] = state
        drawn, current_A = balance.drawn(state, demand)
        drives[k] = drawn[:, SOC], current_A
        if k + 1 < count:
            physics = additions.during(k) if additions else balance
            state = advanced(physics, state, demand, (air[k], air[k + 1]), period_s)
        if progress and k % _PROGRESS_EVERY == 0:
            progress(k, count)
    return [
        Driven(run, each[:, :size], drives[: run.samples, 0, index], drives[: run.samples, 1, index], each[:, size:])
        for index, run in enumerate(runs)
        for each in (nodes[: run.samples, index],)
    ]


class Rates(Protocol):
    """Equations: those of the phones alone, or with what is added to them."""

    def rates(self, state: Array, air_degC: Array, demand: Demand, /) -> Array:
        """dT/dt in K/s."""


def advanced(balance: Rates, state: Array, demand: Demand, air_degC: tuple[Array, Array], period_s: float) -> Array:
    """The state one sample later, while the air goes straight from the one temperature to the other."""
    now, slope_K_s = air_degC[0], (air_degC[1] - air_degC[0]) / period_s
    substeps = math.ceil(period_s / LONGEST_STEP_S)
    step_s = period_s / substeps

    def rates(elapsed_s: float, nodes: Array) -> Array:
        return balance.rates(nodes, now + slope_K_s * elapsed_s, demand)

    for substep in range(substeps):
        state = rk4_step(rates, substep * step_s, state, step_s)
    return state


def _stacked(rows: Sequence[NDArray[_Number]], count: int) -> NDArray[_Number]:
    """Rows of unlike length as columns, the shorter ones going on as they end, shape (count, batch)."""
    return np.stack([np.pad(row, (0, count - len(row)), mode="edge") for row in rows], axis=1)
