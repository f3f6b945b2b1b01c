"""A zone that cannot teach anything is left out before the search, and said: dead, constant, stuck, idle or a double.

A bad zone costs more than its own place: dead readings pull every fit, a double makes a choice between equals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Trace

Array = NDArray[np.float64]

LOWEST_DEGC, HIGHEST_DEGC = -60.0, 200.0
"""Beyond these no zone of a device that runs can be: what reads so is not connected."""
_MOST_MISSING = 0.05
_STUCK_S = 300.0
_STUCK_SHARE = 0.02
_MEANWHILE_K = 5.0
_IDLE_SHARE = 0.02
_SAME_K = 1e-6


@dataclass(frozen=True)
class LeftOut:
    """A column and why the search does without it."""

    column: str
    why: str


@dataclass(frozen=True)
class Sensor:
    """A column that is searched, and how finely and how steadily it reads."""

    column: str
    step_degC: float
    """The smallest difference between two of its readings: what it is rounded to."""
    noise_degC: float
    """Standard deviation of what changes from sample to sample."""

    @property
    def name(self) -> str:
        """The column without its unit."""
        return self.column.removesuffix("_degC")


class Screened(NamedTuple):
    """What can be searched and what cannot."""

    sensors: tuple[Sensor, ...]
    left_out: tuple[LeftOut, ...]


def screened(traces: Sequence[Trace]) -> Screened:
    """The temperatures that every trace holds and that can teach something, and those that are left out."""
    names = list(
        dict.fromkeys(
            each for trace in traces for each in trace.columns if each.endswith("_degC") and each != REFERENCE
        )
    )
    if not names:
        raise refuse(traces[0].path, "line 1", "no '_degC' column besides the reference", "log a sensor")
    left: dict[str, str] = {}
    for name in names:
        why = _absent(name, traces) or _unusable([trace.columns[name] for trace in traces])
        if why is not None:
            left[name] = why
    for name in [each for each in names if each not in left]:
        why = _idle(name, traces, [each for each in names if each not in left])
        if why is not None:
            left[name] = why
    kept: list[str] = []
    for name in [each for each in names if each not in left]:
        twin = next((other for other in kept if _same(name, other, traces)), None)
        if twin is None:
            kept.append(name)
        else:
            left[name] = f"reads the same as {twin.removesuffix('_degC')}"
    out = tuple(LeftOut(name, left[name]) for name in names if name in left)
    return Screened(tuple(_sensor(name, traces) for name in kept), out)


def _absent(name: str, traces: Sequence[Trace]) -> str | None:
    without = [trace.path for trace in traces if name not in trace.columns]
    return f"not in {', '.join(without)}" if without else None


def _unusable(readings: Sequence[Array]) -> str | None:
    """Why the column by itself is of no use."""
    values = np.concatenate(readings)
    known = values[~np.isnan(values)]
    missing = 1 - len(known) / max(len(values), 1)
    if not len(known):
        return "empty"
    if missing > _MOST_MISSING:
        return f"{100 * missing:.0f} % of its values are missing"
    if known.min() < LOWEST_DEGC or known.max() > HIGHEST_DEGC:
        worst = known.min() if known.min() < LOWEST_DEGC else known.max()
        return f"dead: it reads {worst:g} degC"
    if np.ptp(known) == 0:
        return f"constant: {known[0]:g} degC all the time"
    return None


def _idle(name: str, traces: Sequence[Trace], others: Sequence[str]) -> str | None:
    """Why the column is of no use beside the others: it stands still while they move."""
    peers = [other for other in others if other != name]
    if not peers:
        return None
    own = float(np.nanstd(np.concatenate([trace.columns[name] for trace in traces])))
    theirs = float(np.median([np.nanstd(np.concatenate([trace.columns[each] for trace in traces])) for each in peers]))
    if own < _IDLE_SHARE * theirs:
        return f"stuck: it moves by {own:.2g} degC (standard deviation), the median zone by {theirs:.2g}"
    for trace in traces:
        values = trace.columns[name]
        start, stop = _longest_still(values)
        lasted_s = float(trace.time_s[stop - 1] - trace.time_s[start])
        whole_s = float(trace.time_s[-1] - trace.time_s[0])
        if lasted_s < max(_STUCK_S, _STUCK_SHARE * whole_s):
            continue
        moved = [_range(trace.columns[each][start:stop]) for each in peers]
        if float(np.quantile(moved, 0.25)) > _MEANWHILE_K:
            meanwhile = f"while the others moved by {float(np.median(moved)):.1f} degC (median)"
            return f"stuck: {values[start]:g} degC from {trace.time_s[start]:g} s on for {lasted_s:.0f} s, {meanwhile}"
    return None


def _longest_still(values: Array) -> tuple[int, int]:
    """The longest run (start, stop) of one and the same reading."""
    breaks = np.flatnonzero(np.diff(values) != 0) + 1
    edges = np.concatenate([[0], breaks, [len(values)]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])


def _range(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _same(one: str, other: str, traces: Sequence[Trace]) -> bool:
    """Whether two columns differ by a constant at most."""
    apart = np.concatenate([trace.columns[one] - trace.columns[other] for trace in traces])
    known = apart[~np.isnan(apart)]
    return len(known) > 0 and float(np.ptp(known)) <= _SAME_K


def _sensor(name: str, traces: Sequence[Trace]) -> Sensor:
    """Second differences of white noise have six times its variance; their median shrugs off what really moves."""
    known = [values[~np.isnan(values)] for values in (trace.columns[name] for trace in traces)]
    levels = np.unique(np.round(np.concatenate(known), 6))
    step = float(np.round(np.diff(levels).min(), 6))
    bends = np.concatenate([np.diff(each, 2) for each in known])
    noise = 1.4826 * float(np.median(np.abs(bends))) / np.sqrt(6) if len(bends) else 0.0
    return Sensor(name, step, max(noise, step / np.sqrt(12)))
