"""Many phones at once, each with effects of its own hidden in it, and apart from their traces the truth about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused
from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.additions import Added, together
from ambient_trainer.simulator.device import Chamber, Phone
from ambient_trainer.simulator.effects.effect import SOURCE, Hidden, run_faults
from ambient_trainer.simulator.effects.figures import Ran
from ambient_trainer.simulator.effects.physics import Setting, added
from ambient_trainer.simulator.effects.sensors import Ailing
from ambient_trainer.simulator.effects.signals import SIGNALS, signal
from ambient_trainer.simulator.effects.truth import Truth, size_degC, truth
from ambient_trainer.simulator.phone import trace_of
from ambient_trainer.simulator.run import Driven, Progress, Run, integrate, prepare, stream
from ambient_trainer.simulator.scenario import load_scenario
from ambient_trainer.simulator.zones import Zone, thesis_zones

Array = NDArray[np.float64]

Asked = tuple[str, int, Sequence[Hidden]]
"""Scenario name, seed, effects."""


@dataclass(frozen=True)
class Simulated:
    """A run: what was logged, and what only the test or the benchmark may know."""

    trace: Trace
    truths: tuple[Truth, ...]
    clean: Trace | None
    """The same run with the same noise, its signals and decoys, and nothing hidden; None where it was not run."""


def simulate_hidden(
    runs: Sequence[Asked],
    period_s: float = 5.0,
    decoys: Sequence[str] = (),
    sizes: bool = False,
    progress: Progress | None = None,
    zones: Sequence[Zone] | None = None,
) -> list[Simulated]:
    """The traces of several (scenario name, seed, effects), in the time of the longest; raises :class:`Refused`.

    A run without effects, or with some of size zero, has the very trace of ``phone.simulate``, with the columns of its
    signals and of the ``decoys``, which change no temperature. With ``sizes`` every run goes through once more without
    its effects, and, where it has several, with each alone, for ``clean`` and ``Truth.size_degC``. ``progress`` is told
    (samples done, all).
    """
    _check(runs, decoys)
    zones = zones or thesis_zones()
    asked = [(name, seed, tuple(effects)) for name, seed, effects in runs]
    every = list(dict.fromkeys([*asked, *_twins(asked)] if sizes else asked))
    done = dict(zip(every, _simulated(every, period_s, decoys, progress, zones)))
    return [_answered(each, done, sizes) for each in asked]


_Key = tuple[str, int, tuple[Hidden, ...]]


@dataclass(frozen=True)
class _Done:
    trace: Trace
    ran: tuple[Ran, ...]


def _twins(asked: Sequence[_Key]) -> list[_Key]:
    """Each run without its effects and, where there are several, with each of them alone."""
    alone: list[_Key] = [(name, seed, (effect,)) for name, seed, effects in asked for effect in effects]
    return [*((name, seed, ()) for name, seed, _ in asked), *alone]


def _answered(key: _Key, done: dict[_Key, _Done], sizes: bool) -> Simulated:
    name, seed, effects = key
    run = done[key]
    if not sizes:
        return Simulated(run.trace, tuple(truth(ran) for ran in run.ran), None)
    clean = done[name, seed, ()].trace
    truths = []
    for effect, ran in zip(effects, run.ran):
        one = done[name, seed, (effect,)]
        size, worst = size_degC(one.trace, clean, one.ran[0])
        truths.append(replace(truth(ran), size_degC=size, worst=worst))
    logged = {column: values for column, values in run.trace.columns.items() if column not in clean.columns}
    return Simulated(run.trace, tuple(truths), replace(clean, columns={**clean.columns, **logged}))


def _simulated(
    runs: Sequence[_Key], period_s: float, decoys: Sequence[str], progress: Progress | None, zones: Sequence[Zone]
) -> list[_Done]:
    phone, chamber = Phone.shipped(), Chamber.shipped()
    prepared = [prepare(load_scenario(name), seed, period_s, phone, chamber) for name, seed, _ in runs]
    settings = [_setting(run, seed, effects, period_s) for run, (_, seed, effects) in zip(prepared, runs)]
    parts = [
        [added(effect, setting, index, _random(seed, effect)) for index, effect in enumerate(effects)]
        for setting, (_, seed, effects) in zip(settings, runs)
    ]
    driven = integrate(prepared, period_s, progress, [together(each) for each in parts])
    return [_done(*each, period_s, decoys, zones) for each in zip(runs, driven, settings, parts)]


def _done(
    key: _Key,
    driven: Driven,
    setting: Setting,
    parts: Sequence[Added],
    period_s: float,
    decoys: Sequence[str],
    zones: Sequence[Zone],
) -> _Done:
    name, seed, effects = key
    ailing = Ailing(effects, setting, lambda effect: _random(seed, effect))
    trace = trace_of(driven, name, seed, period_s, zones, ailing)
    trace = replace(trace, columns={**trace.columns, **_logged(setting, seed, decoys, driven.run)})
    both = together(parts)
    ran = [
        Ran(effect, setting, driven, part, both, trace, partial(_random, seed, effect))
        for effect, part in zip(effects, parts)
    ]
    return _Done(trace, tuple(ran))


def _setting(run: Run, seed: int, effects: Sequence[Hidden], period_s: float) -> Setting:
    time_s: Array = (np.arange(run.samples, dtype=np.float64) - run.unrecorded) * period_s
    bare = Setting(time_s, period_s, {})
    windows = {effect.signal: bare.lasting(effect) for effect in effects if effect.signal is not None}
    drawn = {
        name: signal(name, time_s, (max(window[0], 0.0), window[1]), stream(seed, f"signal {name}"))
        for name, window in windows.items()
    }
    return replace(bare, signals=drawn)


def _logged(setting: Setting, seed: int, decoys: Sequence[str], run: Run) -> dict[str, Array]:
    """Signals and decoys by name, so that the order tells nothing."""
    end_s = float(setting.time_s[-1]) + setting.period_s
    columns = dict(setting.signals)
    for name in decoys:
        if name not in columns:
            columns[name] = signal(name, setting.time_s, (0.0, end_s), stream(seed, f"signal {name}"))
    return {name: columns[name][run.unrecorded :] for name in sorted(columns)}


def _random(seed: int, effect: Hidden) -> np.random.Generator:
    """An effect's own, whatever its size and whatever else is hidden."""
    return stream(seed, f"hidden {effect.cause} {effect.location} {effect.signal} {effect.onset_s:g}")


def _check(runs: Sequence[Asked], decoys: Sequence[str]) -> None:
    found = [fault for name, _, effects in runs for fault in run_faults(effects, load_scenario(name).duration_s)]
    unknown = [name for name in decoys if name not in SIGNALS]
    found += [
        Fault(f"decoy {name!r}", "there is no such signal", f"take one of {', '.join(SIGNALS)}") for name in unknown
    ]
    if found:
        raise Refused(SOURCE, found)
