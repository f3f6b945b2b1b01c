"""Access to each unit's log: a few units at a time, each as a trace or as the reason why it cannot be read.

A CSV trace, and a Parquet file without the unit column, is one unit, named after the file. A Parquet file with the
column holds many; so does a folder ``unit=NAME`` of one. Files are looked at in the order of their names.
"""

from __future__ import annotations

import contextlib
import gzip
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote, unquote

import numpy as np
import pandas as pd

from ambient_model.faults import Refused, refuse
from ambient_model.trace import TIME, split_column
from ambient_trainer.data.trace import Trace, frame_trace, load_trace

if TYPE_CHECKING:
    import pyarrow.parquet as pq

UNKNOWN = "unknown"
_CSV = (".csv", ".csv.gz")
_PARQUET = ".parquet"
_LARGEST_BYTES = 2**30
"""Of one unit's log as it is read: a year at 1 Hz takes a quarter of it a column."""
_BYTES_A_ROW = 50
"""Of a CSV trace, about: how long a log is decides only which units the population is begun with."""
FEWEST = 2
"""Units of a population."""
_REASONS, _LONGEST_LINE = 3, 2**20
_LONGEST_NAME = 230


def model_name(unit: str) -> str:
    """What the model file of a unit is called."""
    return f"{quote(unit, safe=' ')}.json"


class Piece(NamedTuple):
    """A file, and the row group in it; None: all of it."""

    path: str
    row_group: int | None = None


@dataclass(frozen=True)
class Entry:
    """Where a unit's log lies, about how many rows and bytes it has, and what is wrong with it at first sight."""

    unit: str
    pieces: tuple[Piece, ...]
    rows: int
    size: int
    labels: tuple[tuple[str, str], ...] = ()
    reason: str | None = None

    @property
    def fault(self) -> str | None:
        """What is wrong with it, its size too."""
        if self.reason is None and self.size > _LARGEST_BYTES:
            return f"{self.size:,} bytes: cut it, no unit's log is larger than a gigabyte"
        return self.reason if len(model_name(self.unit)) <= _LONGEST_NAME else "its name is too long for that of a file"


@dataclass(frozen=True)
class Source:
    """Which column holds the unit, which ones its groups, and which columns are wanted (None: all)."""

    by: str
    within: tuple[str, ...] = ()
    columns: tuple[str, ...] | None = None

    def takes(self, name: str) -> bool:
        """Whether a column of a Parquet file is read."""
        if name in (TIME, self.by, *self.within):
            return True
        if self.columns is not None:
            return name in self.columns
        return not name.startswith("__index") and split_column(name) != ("", "")


class Log(NamedTuple):
    """A unit's log: its trace, or the reason why there is none; the group that it belongs to."""

    unit: str
    trace: Trace | None
    group: tuple[str, ...]
    reason: str | None


def entries(path: str, source: Source) -> list[Entry]:
    """The units at ``path``, in the order of their names; a file that cannot be read is one, with the reason.

    Raises :class:`Refused` where there is no such place, or no log in it.
    """
    if not os.path.exists(path):
        raise refuse(path, "", "there is no such file or folder", "name a folder of traces, or a Parquet dataset")
    found: dict[str, Entry] = {}
    for file in _files(path):
        for each in _entries_in(file, path, source.by):
            if (other := found.get(each.unit)) is not None:
                pieces, rows, size = other.pieces + each.pieces, other.rows + each.rows, other.size + each.size
                each = replace(other, pieces=pieces, rows=rows, size=size, reason=other.reason or each.reason)
            found[each.unit] = each
    if not found:
        hint = "put .csv, .csv.gz or .parquet files there, one a unit or with a column"
        raise refuse(path, "", "holds no trace", hint)
    return [found[name] for name in sorted(found)]


def too_few(path: str, units: Iterable[tuple[str, str | None]]) -> Refused:
    """The refusal of a dataset without two units that can be fitted, given each unit with what is wrong with it."""
    found = list(units)
    lost = [f"{unit}: {reason}" for unit, reason in found if reason is not None]
    good = len(found) - len(lost)
    problem = f"a fleet has {FEWEST} units at least, and {good or 'none'} of {len(found)} here can be fitted"
    if lost:
        more = f"; and {len(lost) - _REASONS} more" * (len(lost) > _REASONS)
        return refuse(path, "", f"{problem} ({'; '.join(lost[:_REASONS])}{more})", "correct these logs, or add others")
    hint = "name a folder of traces, one a unit, or a Parquet file whose --by column names each unit; fit one by `fit`"
    return refuse(path, "", problem, hint)


def _files(path: str) -> Iterable[str]:
    if os.path.isfile(path):
        return [path]
    found = []
    for folder, folders, names in os.walk(path):
        folders[:] = [each for each in folders if not each.startswith((".", "_"))]
        made = "fleet.parquet" if "population.json" in names else None  # by a run before
        found += [os.path.join(folder, each) for each in names if not each.startswith((".", "_")) and each != made]
    return sorted(each for each in found if each.endswith((*_CSV, _PARQUET)))


def _entries_in(file: str, path: str, by: str) -> Iterator[Entry]:
    labels = _partition(file, path)
    name = labels.get(by) or os.path.basename(file).partition(".csv")[0].removesuffix(_PARQUET)
    kept = tuple(sorted(labels.items()))
    try:
        if not file.endswith(_PARQUET):
            size = os.path.getsize(file)
            yield Entry(name, (Piece(file),), size // _BYTES_A_ROW, size, kept, None if _has_rows(file) else "no rows")
            return
        opened = _opened(file)
        columns = opened.schema_arrow.names
        for index in range(opened.metadata.num_row_groups):
            group = opened.metadata.row_group(index)
            counts = {name: group.num_rows}
            if by in columns and by not in labels and (only := _only(group, by)) is not None:
                counts = {only: group.num_rows}
            elif by in columns and by not in labels:
                found = opened.read_row_group(index, columns=[by]).column(0).cast("string").value_counts()
                counts = {str(each["values"].as_py()): each["counts"].as_py() for each in found}
            for unit, count in counts.items():
                yield Entry(unit, (Piece(file, index),), count, 8 * count * len(columns), kept)
        if not opened.metadata.num_row_groups:
            yield Entry(name, (Piece(file),), 0, 0, kept, "no rows")
    except (OSError, ValueError, NotImplementedError) as error:
        yield Entry(name, (Piece(file),), 0, 0, kept, _unreadable(error))


def _only(group: pq.RowGroupMetaData, by: str) -> str | None:
    """The unit of a row group whose footer says that it holds no other: to read the names takes ten times as long.

    Where a footer has shortened a text, least and greatest differ.
    """
    columns = (group.column(index) for index in range(group.num_columns))
    known = next((each.statistics for each in columns if each.path_in_schema == by), None)
    if known is None or not known.has_min_max or known.null_count != 0 or known.min != known.max:
        return None
    return known.min if isinstance(known.min, str) else None


def _has_rows(file: str) -> bool:
    """Whether a CSV trace has more than a header."""
    with gzip.open(file, "rb") if file.endswith(".gz") else open(file, "rb") as stream:
        # a hole is a line of gigabytes
        lines = iter(lambda: stream.readline(_LONGEST_LINE), b"")
        rows = (line for line in lines if line.strip() and not line.startswith(b"#"))
        return next(islice(rows, 1, None), None) is not None


def _unreadable(error: Exception) -> str:
    return f"cannot be read ({str(error).partition(chr(10))[0][:200] or type(error).__name__})"


def _partition(file: str, path: str) -> dict[str, str]:
    """What the folders between say, in the form NAME=VALUE."""
    folders = os.path.relpath(os.path.dirname(file), path if os.path.isdir(path) else os.path.dirname(path) or ".")
    pairs = (part.partition("=") for part in folders.split(os.sep) if "=" in part)
    return {name: unquote(value) for name, _, value in pairs}


def logs(wanted: Sequence[Entry], source: Source) -> Iterator[Log]:
    """The logs of some units, in their order; each row group is read once where neighbours share it."""
    opened, units = lru_cache(1)(_opened), sorted(each.unit for each in wanted)
    rows = lru_cache(1)(lambda piece: _rows(opened(piece.path), piece.row_group, source, units))
    for entry in wanted:
        labels, trace, reason = dict(entry.labels), None, entry.fault
        try:
            if reason is None:
                trace = _trace(entry, source, rows, labels)
        except Refused as refused:
            reason = reason_of(refused)
        except (OSError, ValueError) as error:
            reason = _unreadable(error)
        yield Log(entry.unit, trace, tuple(labels.get(name, UNKNOWN) for name in source.within), reason)


def reason_of(refused: Refused) -> str:
    """Why a unit has no row of figures: the faults, without the place of its log."""
    return "; ".join(f"{each.place}: {each.problem}" if each.place else each.problem for each in refused.faults)


def _trace(entry: Entry, source: Source, rows: Callable[[Piece], pd.DataFrame], labels: dict[str, str]) -> Trace:
    """The trace of a unit; what it says of its groups goes to ``labels``."""
    if entry.pieces[0].path.endswith(_PARQUET):
        parts = [rows(piece) for piece in entry.pieces]
        parts = [each[each[source.by] == entry.unit] if source.by in each else each for each in parts]
        frame = pd.concat(parts, ignore_index=True)
        if TIME not in frame:
            raise refuse(entry.unit, f"column {TIME}", "missing", "log the time in s beside the readings")
        labels.update({name: str(frame[name].iloc[0]) for name in source.within if name in frame and len(frame)})
        trace = frame_trace(frame.drop(columns=[source.by, *source.within], errors="ignore"), entry.unit)
    elif len(entry.pieces) > 1:
        raise refuse(entry.unit, "", "two files have the name of this unit", "rename one")
    else:
        trace = load_trace(entry.pieces[0].path)
        labels.update({name: trace.notes[name] for name in source.within if name in trace.notes})
    return require_values(trace, source.columns or ())


def require_values(trace: Trace, columns: Iterable[str]) -> Trace:
    """The trace; raises :class:`Refused` where one of ``columns`` is missing or holds no value."""
    for name in columns:
        if not np.isfinite(trace.column(name)).any():
            raise refuse(trace.path, f"column {name}", "holds no value at all", "leave the unit out, or log it again")
    return trace


def _rows(opened: pq.ParquetFile, row_group: int | None, source: Source, units: Sequence[str]) -> pd.DataFrame:
    """The rows of some units in a row group."""
    import pyarrow as pa
    import pyarrow.compute as pc

    wanted = [name for name in opened.schema_arrow.names if source.takes(name)]
    table = opened.read_row_group(row_group, columns=wanted, use_threads=False)
    if source.by in wanted:
        names = table.column(source.by).cast(pa.string())
        table = table.set_column(wanted.index(source.by), source.by, names)
        table = table.filter(pc.is_in(names, value_set=pa.array(units)))
    return table.to_pandas(use_threads=False, ignore_metadata=True)


def _opened(path: str) -> pq.ParquetFile:
    import pyarrow.parquet as pq

    return pq.ParquetFile(path)


def write_dataset(folder: str, rows: Iterable[tuple[str, Trace, dict[str, str]]], each: int = 50) -> int:
    """Write units (name, trace, labels) as a Parquet dataset, ``each`` a file, one row group a unit; their number.

    Raises :class:`Refused` where the folder holds something already.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    os.makedirs(folder, exist_ok=True)
    if os.listdir(folder):
        raise refuse(folder, "", "is not empty", "name a new folder for the dataset")
    count = -1
    with contextlib.ExitStack() as opened:
        for count, (unit, trace, labels) in enumerate(rows):
            length = len(trace.time_s)
            named = {"unit": unit, **labels}
            texts = {name: pa.array([text] * length).dictionary_encode() for name, text in named.items()}
            table = pa.table({**texts, TIME: trace.time_s, **trace.columns})
            if count % each == 0:
                opened.close()
                path = os.path.join(folder, f"part-{count // each:05d}.parquet")
                writer = opened.enter_context(pq.ParquetWriter(path, table.schema))
            writer.write_table(table, row_group_size=max(length, 1))
    return count + 1
