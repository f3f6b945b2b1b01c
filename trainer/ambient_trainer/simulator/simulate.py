"""What simulated devices log in scenarios, with effects hidden in them; apart from the trace, the truth about them.

The truth is in the terms of a diagnosis, computed from the physics that ran, and never logged. The same scenario,
device, seed, period and effects give the same trace.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ambient_model.faults import Fault, Refused
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.simulator.additions import Added, together
from ambient_trainer.simulator.device import DEFAULT, Device, Zone, load_device
from ambient_trainer.simulator.heat import HeatBalance
from ambient_trainer.simulator.hidden import SOURCE, Acting, Hidden, Ran, faults, run_faults
from ambient_trainer.simulator.run import Driven, Progress, Run, integrate, prepare, stream
from ambient_trainer.simulator.scenario import Scenario, load_scenario
from ambient_trainer.simulator.signals import SIGNALS, signal
from ambient_trainer.simulator.text import parse_hidden

_GAIN_REFERENCE_DEGC = 25.0
Asked = tuple[str, int] | tuple[str, int, Sequence[Hidden]]
"""Scenario, seed and, where there are some, effects."""


@dataclass(frozen=True)
class Truth:
    """What a diagnosis should report of one effect.

    ``location`` is the simulated node, ``a-b``, the sensor, or None; ``sensor_location`` is the same by the names of
    the device's sensors, which circuits call their nodes, None where no sensor is there. ``onset_s`` is None for since
    ever, ``end_s`` for to the end. ``magnitude`` is in ``unit``; ``others`` are further figures, (value, unit).
    """

    cause: str
    location: str | None
    sensor_location: str | None
    signal: str | None
    onset_s: float | None
    end_s: float | None
    magnitude: float
    unit: str
    others: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    size_degC: float | None = None
    """RMS over the time it is there of what it changes, in the trace's worst column; None where that was not run."""
    worst: str | None = None
    """That column: a sensor, or the reference for a clock."""


@dataclass(frozen=True)
class Simulated:
    """A run: what was logged, and what only a test or a benchmark may know."""

    trace: Trace
    hidden: tuple[Hidden, ...]
    truths: tuple[Truth, ...]
    """One an effect."""
    clean: Trace | None
    """The same run with the same noise, its signals and decoys, and nothing hidden; None where it was not run."""


def simulate(
    scenario: str,
    device: str | Device = DEFAULT,
    seed: int = 0,
    period_s: float = 1.0,
    hide: Sequence[str | Hidden] = (),
    *,
    decoys: Sequence[str] = (),
    all_zones: bool = False,
    sizes: bool = False,
    progress: Progress | None = None,
) -> Simulated:
    """Simulate what a device logs in a scenario.

    As :func:`ambient_trainer.simulate`, which describes the parameters; ``device`` and effects may be data, too.
    ``sizes`` runs once more without the effects, and with each alone, for ``clean`` and ``Truth.size_degC``. Raises
    :class:`Refused` with every fault of the scenario, the device or the effects.
    """
    unit = load_device(device) if isinstance(device, str) else device
    texts = [each for each in hide if isinstance(each, str)]
    read = iter(parse_hidden(texts, seed, load_scenario(scenario).duration_s, unit))
    hidden = [next(read) if isinstance(each, str) else each for each in hide]
    zones = unit.zones if all_zones else unit.main_zones
    return simulate_many([(scenario, seed, hidden)], period_s, decoys, sizes, progress, zones, unit)[0]


def simulate_many(
    runs: Sequence[Asked],
    period_s: float = 1.0,
    decoys: Sequence[str] = (),
    sizes: bool = False,
    progress: Progress | None = None,
    zones: Sequence[Zone] | None = None,
    device: Device | None = None,
) -> list[Simulated]:
    """Simulate several (scenario, seed, effects), each as :func:`simulate` does, in the time of the longest.

    A run without effects, or with some of size zero, has the same bytes but for the columns of signals and decoys.
    """
    device = device or load_device()
    asked: list[_Key] = [(name, of, tuple(hidden[0]) if hidden else ()) for name, of, *hidden in runs]
    _check(asked, decoys, device)
    bare: list[_Key] = [(name, of, ()) for name, of, _ in asked]
    alone: list[_Key] = [(name, of, (each,)) for name, of, hidden in asked for each in hidden]
    every = list(dict.fromkeys([*asked, *bare, *alone] if sizes else asked))
    runs_of_all = []
    for key in every:
        name, of, hidden = key
        # random numbers of each one's own, whatever its size and whatever else is hidden
        named = [(each, f"hidden {each.cause} {each.location} {each.signal} {each.onset_s:g}") for each in hidden]
        logging = zones or device.main_zones
        runs_of_all.append(planned((name, of), load_scenario(name), device, logging, period_s, named, decoys))
    done = dict(zip(every, logged(runs_of_all, period_s, progress)))
    return [_answered(key, done, sizes) for key in asked]


@dataclass(frozen=True)
class Planned:
    """A run that the sensors of ``zones`` are to log, with what acts in it and the ``signals`` of that."""

    scenario: str
    seed: int
    run: Run
    zones: Sequence[Zone]
    acting: Sequence[Acting] = ()
    signals: Mapping[str, Array] = field(default_factory=dict)
    gains: Mapping[str, float] = field(default_factory=dict)
    """By zone the relative error of its sensor's slope, about 25 degC."""


class Logged(NamedTuple):
    """What device and laboratory log of a run, from the recording's first sample on; how it went; its effects."""

    trace: Trace
    driven: Driven
    effects: list[Ran]


def logged(planned: Sequence[Planned], period_s: float, progress: Progress | None = None) -> list[Logged]:
    """What comes of runs of one device, in the time of the longest."""
    parts = [[effect.part(number) for number, effect in enumerate(each.acting)] for each in planned]
    driven = integrate([each.run for each in planned], period_s, progress, list(map(together, parts)))
    return [_logged(each, period_s, done, own) for each, done, own in zip(planned, driven, parts)]


def _logged(planned: Planned, period_s: float, driven: Driven, parts: Sequence[Added]) -> Logged:
    run, device, seed, air_degC = driven.run, driven.run.device, planned.seed, driven.run.air_degC
    kept = slice(run.unrecorded, None)
    columns: dict[str, Array] = {}
    for zone in planned.zones:
        here = [each for each in planned.acting if each.hidden.location == zone.name]
        warm = device.felt(zone, driven.nodes_degC, period_s)
        warm = warm + planned.gains.get(zone.name, 0.0) * (warm - _GAIN_REFERENCE_DEGC)
        for each in here:
            warm = each.effect.felt(each, warm)
        reading = zone.reported(warm, stream(seed, f"zone {zone.name}").standard_normal(len(warm)))
        for each in here:
            reading = each.effect.read(each, reading, zone.step_degC)
        columns[f"{zone.name}_degC"] = reading[kept]
    for each in planned.acting:
        air_degC = each.effect.air(each, air_degC)
    columns[REFERENCE] = device.chamber.probes.reading(air_degC, period_s, stream(seed, "probes"))[kept]
    columns[device.processor.logs] = np.round(driven.processor_W[kept], 3)
    for name, idle in device.activities[device.idle].logs.items():
        values = np.array([each.logs.get(name, idle) for each in device.activities.values()])
        columns[name] = values[run.activity[kept]]
    if device.battery:
        columns[device.battery.logs] = np.round(driven.current_A[kept], 3)
    if device.fan:
        columns[device.fan.logs] = np.round(HeatBalance([device]).fan_frac(driven.nodes_degC[kept]), 3)
    time_s = np.round(np.arange(len(run.air_degC) - run.unrecorded) * period_s, 6)
    # in an order that reveals nothing
    columns |= {name: values[kept] for name, values in sorted(planned.signals.items())}
    notes = {"simulated": "yes", "scenario": planned.scenario, "seed": str(seed)}
    trace = Trace(f"scenario {planned.scenario}", time_s, columns, notes)
    in_it: dict[str, Any] = {"driven": driven, "all_added": together(parts), "trace": trace}
    effects = [Ran(**vars(each), **in_it, added=added) for each, added in zip(planned.acting, parts)]
    return Logged(trace, driven, effects)


_Key = tuple[str, int, tuple[Hidden, ...]]


def planned(
    of: tuple[str, int],
    scenario: Scenario,
    device: Device,
    zones: Sequence[Zone],
    period_s: float,
    hidden: Sequence[tuple[Hidden, str]],
    decoys: Sequence[str] = (),
    gains: Mapping[str, float] | None = None,
) -> Planned:
    """A run ``of`` a scenario's name and a seed; what is hidden has its own random numbers, by the name beside it."""
    seed = of[1]
    run = prepare(scenario, seed, period_s, device)
    time_s: Array = (np.arange(len(run.air_degC), dtype=np.float64) - run.unrecorded) * period_s
    driving = (*(Hidden("", signal=name) for name in decoys), *(each for each, _ in hidden))
    windows = {each.signal: each.lasting(time_s, period_s) for each in driving}
    signals = {
        name: signal(name, time_s, (max(start_s, 0.0), end_s), stream(seed, f"signal {name}"))
        for name, (start_s, end_s) in windows.items()
        if name is not None
    }
    acting = [Acting(device, time_s, period_s, signals, each, partial(stream, seed, name)) for each, name in hidden]
    return Planned(*of, run, zones, acting, signals, gains or {})


def _answered(key: _Key, done: Mapping[_Key, Logged], sizes: bool) -> Simulated:
    name, seed, hidden = key
    trace, _, ran = done[key]
    truths = tuple(map(truth, ran))
    if not sizes:
        return Simulated(trace, hidden, truths, None)
    clean = done[name, seed, ()].trace
    alone = [done[name, seed, (each,)] for each in hidden]
    measured = [size_degC(one, clean, its) for one, _, (its,) in alone]
    truths = tuple(replace(each, size_degC=size, worst=worst) for each, (size, worst) in zip(truths, measured))
    further = {column: values for column, values in trace.columns.items() if column not in clean.columns}
    return Simulated(trace, hidden, truths, replace(clean, columns={**clean.columns, **further}))


def _check(runs: Sequence[_Key], decoys: Sequence[str], device: Device) -> None:
    found: list[Fault] = []
    for name, _, hidden in runs:
        own = [fault for each in hidden for fault in faults(each, device)]
        found += own or run_faults(hidden, load_scenario(name).duration_s)
    unknown = [name for name in decoys if name not in SIGNALS]
    found += [
        Fault(f"decoy {name!r}", "there is no such signal", f"take one of {', '.join(SIGNALS)}") for name in unknown
    ]
    if found:
        raise Refused(SOURCE, found)


def truth(ran: Ran) -> Truth:
    """The truth about one effect; zero where it was never in force."""
    hidden, there = ran.hidden, ran.there
    named = [ran.device.sensor_of(part) for part in (hidden.location or "").split("-")]
    magnitude, unit, others = ran.effect.magnitude(ran) if there.any() else (0.0, "", {})
    return Truth(
        hidden.cause,
        hidden.location,
        None if None in named else "-".join(map(str, named)),
        hidden.signal,
        float(ran.time_s[int(np.argmax(there))]) if hidden.signal and there.any() else hidden.onset_s or None,
        None if hidden.end_s is None or hidden.end_s >= ran.time_s[-1] else hidden.end_s,
        float(magnitude),
        unit,
        {name: (float(value), of) for name, (value, of) in others.items()},
    )


def size_degC(effect: Trace, clean: Trace, ran: Ran) -> tuple[float, str]:
    """RMS of what an effect changes while it is there, in the worst column, and that column.

    ``clean`` is the same run, with the same noise, without it. The column is a sensor, or the reference where the
    effect changes that alone.
    """
    there = ran.there[ran.driven.run.unrecorded :]
    sensors = [name for name in clean.columns if name.endswith("_degC") and name != REFERENCE]
    names = [REFERENCE] if ran.effect.in_reference else sensors
    if not there.any():
        return 0.0, names[0]
    rms = {name: float(np.sqrt(np.mean((effect.columns[name] - clean.columns[name])[there] ** 2))) for name in names}
    worst = max(rms, key=rms.__getitem__)
    return rms[worst], worst
