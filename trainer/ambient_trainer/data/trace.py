"""A trace in memory: times and one array a column, NaN where a value is missing; from a file or a DataFrame."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_model.trace import LARGEST, REFERENCE, TIME, TraceReader, split_column, write_trace

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

FRAME = "DataFrame"
"""What messages and provenance call a trace that came from no file."""


@dataclass(frozen=True)
class Trace:
    """A logged or simulated run.

    ``time_s`` has shape (n,) and increases; every array in ``columns`` (by contract name, such as ``usb_degC``) has
    shape (n,), with NaN where the value is missing.
    """

    path: str
    time_s: Array
    columns: dict[str, Array]
    notes: dict[str, str] = field(default_factory=dict)
    sha256: str | None = None
    """Of what it was made from, uncut; None where that is the file at ``path``."""

    def column(self, name: str) -> Array:
        """The column ``name``; raises :class:`Refused` where the trace has none."""
        if name not in self.columns:
            hint = f"it has {', '.join(self.columns)}; log it or map it on import"
            raise refuse(self.path, "line 1", f"no column '{name}'", hint)
        return self.columns[name]

    def to_frame(self) -> pd.DataFrame:
        """The columns as a DataFrame indexed by ``time_s``, the notes as its ``attrs``."""
        import pandas as pd  # half a second: asked for where a frame is

        frame = pd.DataFrame(self.columns, index=pd.Index(self.time_s, name=TIME))
        frame.attrs.update(self.notes)
        return frame

    @property
    def reference(self) -> Array:
        """The ambient in degC."""
        return self.column(REFERENCE)

    def cut(self, from_s: float | None, to_s: float | None) -> Trace:
        """The part with from_s <= time_s < to_s; raises :class:`Refused` where nothing is left."""
        start = 0 if from_s is None else int(np.searchsorted(self.time_s, from_s))
        stop = len(self.time_s) if to_s is None else int(np.searchsorted(self.time_s, to_s))
        if stop <= start:
            whole = f"{self.time_s[0]:.10g} to {self.time_s[-1]:.10g} s" if len(self.time_s) else "no samples"
            ends = [f"{word} {at_s:.10g} s" for word, at_s in (("from", from_s), ("to", to_s)) if at_s is not None]
            problem = f"nothing lies {' '.join(ends)} (the trace has {whole})"
            raise refuse(self.path, "", problem, "choose another window")
        kept = {name: values[start:stop] for name, values in self.columns.items()}
        return replace(self, time_s=self.time_s[start:stop], columns=kept)


def is_reference(column: str) -> bool:
    """Whether a column holds the ambient, of this trace or of one that was joined to it."""
    return re.fullmatch(r"ambient(_[0-9]+)?_degC", column) is not None


def load_trace(source: str | os.PathLike[str] | pd.DataFrame) -> Trace:
    """Trace in a CSV file, ``.gz`` too, or in a DataFrame.

    A frame has columns ``<name>_<unit>``, NaN for a missing value, and the time as the column ``time_s`` or the index:
    in s, or dates or durations, which count from the first row; one that counts the rows has one a second. String
    entries of ``DataFrame.attrs`` become the notes.
    Raises :class:`Refused`, naming line or row and column, for anything that the contract does not allow.
    """
    if not isinstance(source, (str, os.PathLike)):
        return frame_trace(source)
    path = os.fspath(source)
    with TraceReader(path) as reader:
        names = reader.header.columns
        flat = itertools.chain.from_iterable(
            (row.time_s, *[np.nan if value is None else value for value in row.values]) for row in reader
        )
        table = np.fromiter(flat, dtype=np.float64).reshape(-1, len(names) + 1)
        if not len(table):
            raise refuse(path, "", "no samples under the header", "log something first")
        columns = {name: np.ascontiguousarray(table[:, index + 1]) for index, name in enumerate(names)}
        return Trace(path, np.ascontiguousarray(table[:, 0]), columns, reader.header.notes)


def frame_trace(frame: pd.DataFrame, source: str = FRAME) -> Trace:
    """The trace in a DataFrame, with arrays of its own."""
    names = [str(name) for name in frame.columns]
    for name in names:
        if split_column(name) == ("", ""):
            raise refuse(source, f"column {name!r}", "names no unit", "name it <name>_<unit>, such as usb_degC")
        if names.count(name) > 1:
            raise refuse(source, f"column {name!r}", "is duplicated", "rename or remove one")
    if not len(frame):
        raise refuse(source, "", "no rows", "log something first")
    time_s = _numbers(source, frame.index.to_series() if TIME not in names else frame[TIME], TIME)
    late = np.flatnonzero(~(np.diff(time_s, prepend=-np.inf) > 0))
    if len(late):
        problem = f"{time_s[late[0]]:.15g} s does not come after the row before"
        raise refuse(source, f"row {late[0]}, {TIME}", problem, "sort the rows and drop doubles: time must increase")
    columns = {name: _numbers(source, frame[name], name) for name in frame.columns if name != TIME}
    notes = {key: value for key, value in frame.attrs.items() if isinstance(key, str) and isinstance(value, str)}
    return Trace(source, time_s, columns, notes)


def _numbers(source: str, values: pd.Series, name: str) -> Array:
    if values.dtype.kind in "mM":
        values = (values - values.iloc[0]).dt.total_seconds()
    try:
        found = values.to_numpy(dtype=np.float64, na_value=np.nan, copy=True)
    except (TypeError, ValueError) as error:
        raise refuse(source, f"column {name}", f"holds no numbers ({error})", "convert it, or leave it out") from error
    beyond = np.flatnonzero(~(np.abs(found) <= LARGEST) & ~(np.isnan(found) & (name != TIME)))
    if len(beyond):
        problem = f"{found[beyond[0]]:g} is no finite measurement"
        raise refuse(source, f"row {beyond[0]}, {name}", problem, "make it NaN for a missing value")
    return found


def save_trace(path: str, trace: Trace) -> None:
    """Write ``trace`` to ``path``, whole or not at all."""
    table = np.column_stack(list(trace.columns.values())) if trace.columns else np.empty((len(trace.time_s), 0))
    rows = (
        (time_s, [None if value != value else value for value in values])
        for time_s, values in zip(trace.time_s.tolist(), table.tolist())
    )
    write_trace(path, list(trace.columns), rows, trace.notes)


def sha256_of(path: str) -> str:
    """The SHA-256 of a trace's file, in lower-case hexadecimal: a model says so what it was trained on."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
