"""Runs are integrated together: units of one device, each with its own scenario and weather, in one loop over arrays.

What is asked of device and chamber changes at samples and holds until the next; the air moves in straight lines between
them.
"""

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.additions import Added, Additions
from ambient_trainer.simulator.chamber import ramped, wobble
from ambient_trainer.simulator.device import Bursts, Device
from ambient_trainer.simulator.heat import HeatBalance, advanced
from ambient_trainer.simulator.scenario import Scenario

Progress = Callable[[int, int], None]
"""Receives (samples done, all)."""
Control = Callable[[int, Array, Array], Array]
"""From a sample, the nodes then, (batch, nodes), and what the processors drew before to their caps in W, (batch,)."""
_Number = TypeVar("_Number", np.float64, np.intp)

_LEAST_BURST = 0.1
_PROGRESS_EVERY = 500


@dataclass(frozen=True)
class Run:
    """What a device is put through: n samples, the first ``unrecorded`` of them before the recording.

    It starts from the steady state at ``start_degC``, with its first activity and no burst.
    """

    device: Device
    start_degC: float
    air_degC: Array
    activity: NDArray[np.intp]
    """Indices of the device's activities."""
    burst: Array
    """Factor of the processor's demanded power."""
    unrecorded: int


@dataclass(frozen=True)
class Driven:
    """Node temperatures in degC, shape (n, nodes), of one run, with its drives, shape (n,)."""

    run: Run
    nodes_degC: Array
    processor_W: Array
    current_A: Array
    bodies_degC: Array
    """Of what is added to the device, shape (n, bodies)."""


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Random numbers of their own for each purpose: one more zone changes none of the others."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def prepare(scenario: Scenario, seed: int, period_s: float, device: Device) -> Run:
    """The air, the activities and the bursts of one run, in the device's chamber."""
    chamber = device.chamber
    unrecorded = math.ceil(scenario.before_s / period_s - 1e-9)
    recorded = math.ceil(scenario.duration_s / period_s - 1e-9)
    time_s: Array = np.arange(-unrecorded, recorded, dtype=np.float64) * period_s
    set_point_degC, gradient_K_min, activity = schedule(scenario, time_s, device)
    swing = wobble(len(time_s), period_s, chamber, stream(seed, "wobble"))
    air_degC = ramped(set_point_degC, period_s, chamber, gradient_K_min) + swing
    burst = np.ones(len(time_s))
    for index, each in enumerate(device.activities.values()):
        if each.bursts:
            burst = np.where(activity == index, bursts(time_s, each.bursts, stream(seed, "bursts")), burst)
    return Run(device, float(set_point_degC[0]), air_degC, activity, burst, unrecorded)


def bursts(time_s: Array, swing: Bursts, random: np.random.Generator) -> Array:
    """The factor of the processor's power while it works in bursts, never negative."""
    phase = random.uniform(0.0, 2.0 * math.pi)
    wave = math.sqrt(2.0) * np.sin(2.0 * math.pi / swing.period_s * time_s + phase)
    return np.maximum(1.0 + swing.frac * wave, _LEAST_BURST)


def schedule(scenario: Scenario, time_s: Array, device: Device) -> tuple[Array, Array, NDArray[np.intp]]:
    """The chamber's set point in degC, its gradient, the activity's index at ``time_s`` (0: recording), shape (n,)."""
    steps = scenario.program
    ends_s = np.cumsum([60.0 * (step.duration_min or 0.0) for step in steps]) - scenario.before_s
    current = np.searchsorted(ends_s, time_s + 1e-9, side="right")
    set_points = np.array([step.chamber_degC for step in steps], dtype=np.float64)
    gradients = np.array([step.gradient_K_min or math.inf for step in steps])
    activities = np.array([device.activity_index(step.load) for step in steps])
    return set_points[current], gradients[current], activities[current]


def integrate(
    runs: Sequence[Run],
    period_s: float,
    progress: Progress | None = None,
    added: Sequence[Added] = (),
    control: Control | None = None,
) -> list[Driven]:
    """The runs' temperatures, sample by sample; the longest run sets the time it takes.

    ``added`` is what each run's device has in addition, or nothing for all of them; ``control`` closes a loop.
    """
    balance = HeatBalance([run.device for run in runs])
    additions = Additions(balance, added) if any(each.terms or each.links for each in added) else None
    lengths = [len(run.air_degC) for run in runs]
    count = max(lengths)
    air = _stacked([run.air_degC for run in runs], count)
    activity = _stacked([run.activity for run in runs], count)
    burst = _stacked([run.burst for run in runs], count)
    size = balance.size
    nodes = np.empty((count, len(runs), additions.width if additions else size))
    drives = np.empty((count, 2, len(runs)))
    start_degC = np.array([run.start_degC for run in runs])
    first = balance.demand(activity[0], np.ones(len(runs)))
    state = balance.equilibrium(start_degC, first)
    if additions:
        state = additions.start(state, start_degC, first)
    for k in range(count):
        demand = balance.demand(activity[k], burst[k])
        nodes[k] = state
        if control:
            cap_W = control(k, state[:, :size], drives[k - 1, 0] if k else np.zeros(len(runs)))
            demand.heat_W[:, balance.processor] = np.minimum(demand.heat_W[:, balance.processor], cap_W)
        drawn, current_A = balance.drawn(state, demand)
        drives[k] = drawn[:, balance.processor], current_A
        if k + 1 < count:
            rates = additions.rates_during(k) if additions else balance.rates
            state = advanced(rates, state, demand, (air[k], air[k + 1]), period_s)
        if progress and k % _PROGRESS_EVERY == 0:
            progress(k, count)
    return [
        Driven(run, each[:, :size], drives[:n, 0, index], drives[:n, 1, index], each[:, size:])
        for index, (run, n) in enumerate(zip(runs, lengths))
        for each in (nodes[:n, index],)
    ]


def _stacked(rows: Sequence[NDArray[_Number]], count: int) -> NDArray[_Number]:
    """Rows of unlike length as columns, the shorter ones continued as they end, shape (count, batch)."""
    return np.stack([np.pad(row, (0, count - len(row)), mode="edge") for row in rows], axis=1)
