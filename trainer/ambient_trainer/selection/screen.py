"""Zones that cannot help are left out before the search, with the reason: dead, constant, stuck, idle or a double.

A bad zone costs more than its own place: dead readings pull every fit, a double makes a choice between equals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data import Trace, noise_of
from ambient_trainer.data.trace import is_reference

LOWEST_DEGC, HIGHEST_DEGC = -60.0, 200.0
"""Beyond these no zone of a device that runs can be: what reads so is not connected."""
# chosen on the zones of the two phones and the chamber that were measured: all of theirs that work pass
_MOST_MISSING = 0.05
_STUCK_S = 300.0
_STUCK_SHARE = 0.02
_MEANWHILE_K = 5.0
_IDLE_SHARE = 0.02
_SAME_K = 1e-6


@dataclass(frozen=True)
class Sensor:
    """A column that is searched, the smallest difference between two of its readings, and its noise's deviation."""

    column: str
    step_degC: float
    noise_degC: float

    @property
    def name(self) -> str:
        """The column without its unit."""
        return self.column.removesuffix("_degC")


def screened(traces: Sequence[Trace]) -> tuple[tuple[Sensor, ...], dict[str, str]]:
    """The temperatures that every trace holds and that are usable, and why each other column is left out."""
    temperatures = [each.to_frame().filter(regex="_degC$") for each in traces]
    frames = [each.drop(columns=REFERENCE, errors="ignore") for each in temperatures]
    table = pd.concat(frames, ignore_index=True)
    if table.columns.empty:
        raise refuse(traces[0].path, "line 1", "no '_degC' column besides the reference", "log a sensor")
    why: dict[str, str | None] = {}
    for name in table:
        without = [trace.path for trace, frame in zip(traces, frames) if name not in frame]
        why[name] = f"not in {', '.join(without)}" if without else _unusable(table[name])
        if is_reference(name):
            why[name] = "a further reference is no sensor"
    usable = [name for name in table if why[name] is None]
    why |= {name: _stuck(name, table[usable], [frame[usable] for frame in frames]) for name in usable}
    kept: list[str] = []
    for name in (each for each in usable if why[each] is None):
        twins = [other for other in kept if np.ptp((table[name] - table[other]).dropna()) <= _SAME_K]
        why[name] = f"reads the same as {twins[0].removesuffix('_degC')}" if twins else None
        kept += [] if twins else [name]
    sensors = []
    for name in kept:
        known = [frame[name].dropna().to_numpy() for frame in frames]
        step = float(np.round(np.diff(np.unique(np.round(np.concatenate(known), 6))).min(), 6))
        sensors.append(Sensor(name, step, max(noise_of(known), step / np.sqrt(12))))
    return tuple(sensors), {name: reason for name, reason in why.items() if reason is not None}


def _unusable(values: pd.Series) -> str | None:
    """Why the column by itself is of no use."""
    known = values.dropna()
    if known.empty:
        return "empty"
    if (missing := values.isna().mean()) > _MOST_MISSING:
        return f"{100 * missing:.0f} % of its values are missing"
    if known.min() < LOWEST_DEGC or known.max() > HIGHEST_DEGC:
        return f"dead: it reads {known.min() if known.min() < LOWEST_DEGC else known.max():g} degC"
    if known.min() == known.max():
        return f"constant: {known.iloc[0]:g} degC all the time"
    return None


def _stuck(name: str, table: pd.DataFrame, frames: Sequence[pd.DataFrame]) -> str | None:
    """Why the column is of no use beside the others: it stands still while they move."""
    deviations = table.std(ddof=0)
    others = deviations.drop(name)
    if others.empty:
        return None
    own, theirs = deviations[name], others.median()
    if own < _IDLE_SHARE * theirs:
        return f"stuck: it moves by {own:.2g} degC (standard deviation), the median zone by {theirs:.2g}"
    for frame in frames:
        run = frame[name].diff().ne(0.0).cumsum()
        longest = frame[run == run.groupby(run).size().idxmax()]
        start_s, lasted_s = longest.index[0], longest.index[-1] - longest.index[0]
        meanwhile = longest.drop(columns=name)
        moved = (meanwhile.max() - meanwhile.min()).fillna(0.0)
        long = lasted_s >= max(_STUCK_S, _STUCK_SHARE * (frame.index[-1] - frame.index[0]))
        if long and moved.quantile(0.25) > _MEANWHILE_K:
            place = f"{longest[name].iloc[0]:g} degC from {start_s:.10g} s on for {lasted_s:.0f} s"
            return f"stuck: {place}, while the others moved by {moved.median():.1f} degC (median)"
    return None
