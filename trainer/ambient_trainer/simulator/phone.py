"""A phone in a climate chamber goes through a scenario; the same name, seed and period give the same trace."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.constants import Activity
from ambient_trainer.simulator.device import Chamber, Phone
from ambient_trainer.simulator.instruments import Sound, felt, probe_reading, zone_reading
from ambient_trainer.simulator.run import Driven, Progress, integrate, prepare, stream
from ambient_trainer.simulator.scenario import load_scenario
from ambient_trainer.simulator.zones import Zone, all_zones, thesis_zones

Array = NDArray[np.float64]


def simulate(
    scenario_name: str,
    seed: int = 0,
    period_s: float = 1.0,
    progress: Progress | None = None,
    phone: Phone | None = None,
) -> Trace:
    """The trace of a simulated phone, a sample every ``period_s``; raises :class:`Refused` for an unknown scenario.

    Columns: the five sensors that the thesis reads in degC, ``ambient_degC``, and the drives ``soc_power_W``,
    ``charging_on``, ``cpu_load_frac`` and ``battery_current_A`` (positive into the battery). ``progress`` is told
    (samples done, all). ``phone`` is the calibrated one unless another is given.
    """
    return simulate_many([(scenario_name, seed)], period_s, progress, phone)[0]


def simulate_many(
    runs: Sequence[tuple[str, int]],
    period_s: float = 1.0,
    progress: Progress | None = None,
    phone: Phone | None = None,
    chamber: Chamber | None = None,
) -> list[Trace]:
    """The traces of several (scenario name, seed), each as :func:`simulate` gives it, in the time of the longest."""
    return _traces(runs, period_s, progress, (phone, chamber), thesis_zones())


def simulate_zones(
    scenario_name: str,
    seed: int = 0,
    period_s: float = 1.0,
    progress: Progress | None = None,
    phone: Phone | None = None,
) -> Trace:
    """As :func:`simulate`, with a column for every zone of the phone, about 50."""
    return _traces([(scenario_name, seed)], period_s, progress, (phone, None), all_zones())[0]


def _traces(
    runs: Sequence[tuple[str, int]],
    period_s: float,
    progress: Progress | None,
    parts: tuple[Phone | None, Chamber | None],
    zones: Sequence[Zone],
) -> list[Trace]:
    phone, chamber = parts[0] or Phone.shipped(), parts[1] or Chamber.shipped()
    prepared = [prepare(load_scenario(name), seed, period_s, phone, chamber) for name, seed in runs]
    driven = integrate(prepared, period_s, progress)
    return [trace_of(each, name, seed, period_s, zones, Sound()) for each, (name, seed) in zip(driven, runs)]


def trace_of(
    driven: Driven, scenario_name: str, seed: int, period_s: float, zones: Sequence[Zone], instruments: Sound
) -> Trace:
    """What phone and laboratory log of a run, from the recording's first sample on."""
    kept = slice(driven.run.unrecorded, None)
    columns: dict[str, Array] = {}
    for zone in zones:
        warm = instruments.felt(zone.name, felt(zone, driven.run.phone, driven.nodes_degC, period_s))
        reading = zone_reading(zone, warm, stream(seed, f"zone {zone.name}"))
        columns[f"{zone.name}_degC"] = instruments.read(zone.name, reading, zone.step_degC)[kept]
    air_degC = instruments.air(driven.run.air_degC)
    columns[REFERENCE] = probe_reading(air_degC, period_s, stream(seed, "probes"))[kept]
    columns["soc_power_W"] = np.round(driven.soc_W[kept], 3)
    activity = driven.run.activity[kept]
    columns["charging_on"] = np.array([float(each in c.CHARGING_A) for each in Activity])[activity]
    columns["cpu_load_frac"] = np.array([c.CPU_LOAD_FRAC[each] for each in Activity])[activity]
    columns["battery_current_A"] = np.round(driven.current_A[kept], 3)
    time_s = np.round(np.arange(len(activity)) * period_s, 6)
    notes = {"simulated": "yes", "scenario": scenario_name, "seed": str(seed)}
    return Trace(f"scenario {scenario_name}", time_s, columns, notes)
