"""Traces of several loggers on one clock: the first one's stamps, to which the others' columns are brought.

A column that is logged more often than the stamps stand is averaged around each; one that is logged less often is drawn
as straight lines; a switch (``_on``) keeps its last value. Where a logger has a gap there is nothing.
"""

import contextlib
import itertools
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone

import numpy as np
import pandas as pd

from ambient_model.faults import Refused, refuse
from ambient_model.trace import TIME, TraceReader, split_column
from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Array, Trace, frame_trace, load_trace

_GAP = 3.0
"""In periods of its own: a longer step of a logger is a gap."""
_SINCE_1970_S = 1e9
"""No logger runs for 30 years: a larger start in seconds is Unix time, which is UTC."""
_BY_NOTES = "the start in its notes"


@dataclass(frozen=True)
class Logged:
    """A trace as it was read, how many of its rows were left out because time did not increase, and its ``epoch``.

    ``epoch_s`` is what to add to its time so that it stands on the first trace's clock, by what ``epoch`` says;
    ``comparable`` is False where notes hold a start that could not be used.
    """

    trace: Trace
    dropped_rows: int
    epoch_s: float = 0.0
    epoch: str = "its time_s"
    comparable: bool = True

    def moved(self, shift_s: float = 0.0) -> Trace:
        """The trace on the first one's clock."""
        return replace(self.trace, time_s=self.trace.time_s + self.epoch_s + shift_s)


def load_logged(path: str) -> Logged:
    """The trace in a file whose stamps may repeat or go back: the first of such rows counts. Raises Refused."""
    try:
        return Logged(load_trace(path), 0)
    except Refused:
        with contextlib.suppress(ValueError, OSError, KeyError):
            frame = pd.read_csv(path, comment="#", dtype=np.float64, skip_blank_lines=True)
            later = frame[TIME] > frame[TIME].cummax().shift(fill_value=-np.inf)
            if frame[TIME].notna().all() and not later.all():
                with TraceReader(path) as reader:
                    frame.attrs.update(reader.header.notes)
                return Logged(frame_trace(frame[later], path), int((~later).sum()))
        raise


def on_one_epoch(traces: Sequence[Logged]) -> list[Logged]:
    """The traces with their epochs: by the dates in their notes, else by their times, else from their first samples."""
    first, found = traces[0].trace, []
    for each in traces:
        ours, theirs = _start(first), _start(each.trace)
        overlap = min(first.time_s[-1], each.trace.time_s[-1]) - max(first.time_s[0], each.trace.time_s[0])
        if ours and theirs and ours[0] == theirs[0]:
            found.append(replace(each, epoch_s=theirs[1] - ours[1], epoch=_BY_NOTES))
        elif overlap > 0:
            found.append(each)
        else:
            apart = float(first.time_s[0] - each.trace.time_s[0])
            found.append(replace(each, epoch_s=apart, epoch="its first sample, taken for simultaneous"))
        starts = [repr(trace.notes["start"]) if "start" in trace.notes else "none" for trace in (each.trace, first)]
        if found[-1].epoch != _BY_NOTES and starts != ["none", "none"]:
            taken = ", taken for simultaneous" if overlap > 0 else ""
            why = f"its start in notes ({starts[0]}) cannot be compared with the first trace's ({starts[1]})"
            found[-1] = replace(found[-1], epoch=f"{found[-1].epoch}{taken}, since {why}", comparable=False)
    return found


def _start(trace: Trace) -> tuple[str, float] | None:
    """When time_s was 0, on which clock: by a date in ISO form or seconds of some epoch; None where no note says it."""
    text = trace.notes.get("start", "")
    number, _, unit = text.partition(" ")
    try:
        if unit == "s":
            return "UTC" if float(number) >= _SINCE_1970_S else "epoch", float(number)
        moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
        if moment.tzinfo:
            return "UTC", moment.timestamp()
        return "date", moment.replace(tzinfo=timezone.utc).timestamp()
    except ValueError:
        return None


def joined(traces: Sequence[Trace]) -> Trace:
    """One trace with the columns of all, which are on one clock; the first gives the stamps.

    A name that stands in several gets a number from the second on: ``ambient_2_degC``. Refused: one without overlap.
    """
    first = traces[0]
    columns = dict(first.columns)
    for other in traces[1:]:
        for name, values in other.columns.items():
            brought = _brought(other.time_s, values, first.time_s, name.endswith("_on"))
            if np.isnan(brought).all() and (~np.isnan(values)).sum() > 1:
                its, own = (f"{each.time_s[0]:.10g} to {each.time_s[-1]:.10g} s" for each in (other, first))
                problem = f"no value at any time of the first trace (it has {its}, the first {own}, on one clock)"
                raise refuse(other.path, f"column {name}", problem, "correct or remove 'start' in the notes")
            columns[_free(name, columns)] = brought
    sources = ", ".join(os.path.basename(trace.path) for trace in traces)
    return Trace(first.path, first.time_s, columns, {**first.notes, "joined": sources})


def _free(name: str, taken: dict[str, Array]) -> str:
    base, unit = split_column(name)
    others = (f"{base}_{number}_{unit}" for number in itertools.count(2))
    return next(each for each in itertools.chain([name], others) if each not in taken)


def _brought(time_s: Array, values: Array, stamps_s: Array, switch: bool) -> Array:
    """``values`` at ``stamps_s``, NaN where none is near."""
    known = ~np.isnan(values)
    if known.sum() < 2:
        return np.full(len(stamps_s), np.nan)
    time_s, values = time_s[known], values[known]
    own, wanted = sampling_period_s(time_s), sampling_period_s(stamps_s)
    after = np.searchsorted(time_s, stamps_s, side="right")
    if switch:
        brought = values[np.maximum(after - 1, 0)]
    elif wanted < 1.5 * own:
        brought = np.interp(stamps_s, time_s, values)
    else:
        edges = np.concatenate([stamps_s - wanted / 2, stamps_s + wanted / 2])
        low, high = np.searchsorted(time_s, edges).reshape(2, -1)
        total = np.concatenate([[0.0], np.cumsum(values)])
        brought = np.where(high > low, (total[high] - total[low]) / np.maximum(high - low, 1), np.nan)
    before, next_ = time_s[np.maximum(after - 1, 0)], time_s[np.minimum(after, len(time_s) - 1)]
    far = (next_ - before > _GAP * own) & (stamps_s - before > own / 2) & (next_ - stamps_s > own / 2)
    outside = (stamps_s < time_s[0] - own / 2) | (stamps_s > time_s[-1] + own / 2)
    return np.where(far | outside, np.nan, brought)
