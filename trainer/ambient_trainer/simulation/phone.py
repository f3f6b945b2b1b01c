"""A phone in a climate chamber goes through a scenario; the same name, seed and period give the same trace.

What is asked of phone and chamber changes at samples and holds until the next; the air moves in straight lines between
them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ambient_model.trace import REFERENCE
from ambient_trainer.simulation import constants as c
from ambient_trainer.simulation.chamber import ramped, wobble
from ambient_trainer.simulation.constants import LOADS, Activity, Load
from ambient_trainer.simulation.heat import N, battery_current_A, equilibrium, rates, rk4_step, soc_power_W
from ambient_trainer.simulation.instruments import probe_reading, sensor_reading
from ambient_trainer.simulation.scenario import Scenario, load_scenario
from ambient_trainer.traces.trace import Trace

Array = NDArray[np.float64]

LONGEST_STEP_S = 0.5
_PROGRESS_EVERY = 500


def simulate(
    scenario_name: str,
    seed: int = 0,
    period_s: float = 1.0,
    progress: Callable[[int, int], None] | None = None,
) -> Trace:
    """The trace of a simulated phone, a sample every ``period_s``; raises :class:`Refused` for an unknown scenario.

    Columns: the five sensors in degC, ``ambient_degC``, and the drives ``soc_power_W``, ``charging_on``,
    ``cpu_load_frac`` and ``battery_current_A`` (positive into the battery). ``progress`` is told (samples done, all).
    """
    scenario = load_scenario(scenario_name)
    random = np.random.default_rng(seed)
    time_s: Array = np.arange(math.ceil(scenario.duration_s / period_s - 1e-9), dtype=np.float64) * period_s
    set_point_degC, loads = schedule(scenario, time_s)
    air_degC = ramped(set_point_degC, period_s) + wobble(len(time_s), period_s, random)
    start = equilibrium(float(set_point_degC[0]), LOADS[Activity.IDLE])
    states = integrate(start, air_degC, loads, period_s, progress)
    notes = {"simulated": "yes", "scenario": scenario_name, "seed": str(seed)}
    return Trace(f"scenario {scenario_name}", np.round(time_s, 6), _columns(states, loads, random), notes)


def schedule(scenario: Scenario, time_s: Array) -> tuple[Array, list[Load]]:
    """The chamber's set point in degC, shape (n,), and the load, at each of ``time_s``."""
    ends_s = np.cumsum([60.0 * step.duration_min for step in scenario.steps])
    steps = [scenario.steps[index] for index in np.searchsorted(ends_s, time_s + 1e-9, side="right")]
    return np.array([step.chamber_degC for step in steps]), [LOADS[step.activity] for step in steps]


def integrate(
    start: Array,
    air_degC: Array,
    loads: list[Load],
    period_s: float,
    progress: Callable[[int, int], None] | None = None,
) -> Array:
    """The state at each sample, shape (n, 13), from ``start`` at the first; see :func:`heat.rates` for its parts."""
    count = len(air_degC)
    states = np.empty((count, len(start)))
    states[0] = start
    for k in range(1, count):
        states[k] = _advanced(states[k - 1], loads[k - 1], air_degC[k - 1], air_degC[k], period_s)
        if progress and k % _PROGRESS_EVERY == 0:
            progress(k, count)
    return states


def _advanced(state: Array, load: Load, air_degC: float, air_then_degC: float, period_s: float) -> Array:
    slope_K_s = (air_then_degC - air_degC) / period_s
    substeps = math.ceil(period_s / LONGEST_STEP_S)
    step_s = period_s / substeps

    def derivative(elapsed_s: float, state: Array) -> Array:
        return rates(state, air_degC + slope_K_s * elapsed_s, load)

    for substep in range(substeps):
        state = rk4_step(derivative, substep * step_s, state, step_s)
    return state


def _columns(states: Array, loads: list[Load], random: np.random.Generator) -> dict[str, Array]:
    columns = {f"{sensor}_degC": sensor_reading(states[:, N + index], random) for index, sensor in enumerate(c.SENSORS)}
    columns[REFERENCE] = probe_reading(states[:, -1], random)
    soc_degC = states[:, c.NODES.index("soc")].tolist()
    powers_W = [soc_power_W(temp, load) for temp, load in zip(soc_degC, loads)]
    columns["soc_power_W"] = np.round(powers_W, 3)
    columns["charging_on"] = np.array([float(load.charging_A > 0.0) for load in loads])
    columns["cpu_load_frac"] = np.array([load.cpu_load_frac for load in loads])
    columns["battery_current_A"] = np.round([battery_current_A(*each) for each in zip(powers_W, loads)], 3)
    return columns
