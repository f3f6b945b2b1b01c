"""Where each unit's log lies, and how it is read: a few units at a time, each as a trace or as the reason why not.

A CSV trace, and a Parquet file without the unit column, is one unit, named after the file. A Parquet file with the
column holds many; so does a folder ``unit=NAME`` of one. Files are looked at in the order of their names.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from ambient_model.faults import Refused, refuse
from ambient_model.trace import TIME, split_column
from ambient_trainer.data.trace import Trace, frame_trace, load_trace

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow.parquet as pq

UNKNOWN = "unknown"
_CSV = (".csv", ".csv.gz")
_PARQUET = ".parquet"
_LARGEST_BYTES = 2**30
"""Of one unit's log as it is read: a year at 1 Hz takes a quarter of it a column."""
_BYTES_A_ROW = 50
"""Of a CSV trace, about: how long a log is decides only which units the population is begun with."""


class Piece(NamedTuple):
    """A file, and the row group in it; None: all of it."""

    path: str
    row_group: int | None = None


@dataclass(frozen=True)
class Entry:
    """Where a unit's log lies, about how many rows it has, and what is wrong with it as far as one sees from here."""

    unit: str
    pieces: tuple[Piece, ...]
    rows: int
    labels: tuple[tuple[str, str], ...] = ()
    reason: str | None = None


@dataclass(frozen=True)
class Source:
    """Which dataset, which column holds the unit, which ones its groups, and which columns are wanted (None: all)."""

    by: str
    within: tuple[str, ...] = ()
    columns: tuple[str, ...] | None = None


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
        for each in _entries_in(file, path, source):
            before = found.get(each.unit)
            if before is not None:
                each = replace(
                    before,
                    pieces=(*before.pieces, *each.pieces),
                    rows=before.rows + each.rows,
                    reason=before.reason or each.reason,
                )
            found[each.unit] = each
    if not found:
        raise refuse(
            path, "", "holds no trace", "put .csv, .csv.gz or .parquet files there, one a unit or with a column"
        )
    return [found[name] for name in sorted(found)]


def _files(path: str) -> Iterable[str]:
    if os.path.isfile(path):
        return [path]
    found = [os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names]
    return sorted(each for each in found if each.endswith((*_CSV, _PARQUET)) and not _hidden(each, path))


def _hidden(file: str, path: str) -> bool:
    return any(part.startswith((".", "_")) for part in os.path.relpath(file, path).split(os.sep))


def _entries_in(file: str, path: str, source: Source) -> Iterator[Entry]:
    labels = _partition(file, path)
    named = labels.get(source.by)
    name = named or os.path.basename(file).partition(".csv")[0].removesuffix(_PARQUET)
    kept = tuple(sorted(labels.items()))
    size = os.path.getsize(file)
    if not file.endswith(_PARQUET):
        reason = None if size <= _LARGEST_BYTES else f"{size:,} bytes: cut it, no unit's log is larger than a gigabyte"
        yield Entry(name, (Piece(file),), size // _BYTES_A_ROW, kept, reason)
        return
    try:
        opened = _opened(file)
        if named is None and source.by in opened.schema_arrow.names:
            yield from _units_in(opened, file, source.by, kept)
        else:
            whole = opened.metadata
            groups = tuple(Piece(file, index) for index in range(whole.num_row_groups))
            yield Entry(name, groups, whole.num_rows, kept, _too_large(whole.num_rows * whole.num_columns))
    except (OSError, ValueError) as error:
        yield Entry(name, (Piece(file),), 0, kept, f"cannot be read ({_first_line(error)})")


def _units_in(opened: pq.ParquetFile, file: str, by: str, labels: tuple[tuple[str, str], ...]) -> Iterator[Entry]:
    """The units of each row group: from its statistics where they say that there is one, else from the column."""
    for index in range(opened.metadata.num_row_groups):
        group = opened.metadata.row_group(index)
        known = next((c for c in map(group.column, range(group.num_columns)) if c.path_in_schema == by), None)
        numbers = known.statistics if known is not None else None
        if numbers is not None and numbers.has_min_max and numbers.min == numbers.max and not numbers.null_count:
            counts = {str(numbers.min): group.num_rows}
        else:
            column = opened.read_row_group(index, columns=[by]).column(0)
            counted = column.value_counts()
            counts = {str(each["values"].as_py()): each["counts"].as_py() for each in counted}
        for unit, rows in counts.items():
            reason = _too_large(rows * len(opened.schema_arrow.names))
            yield Entry(unit, (Piece(file, index),), rows, labels, reason)


def _too_large(cells: int) -> str | None:
    if 8 * cells <= _LARGEST_BYTES:
        return None
    return f"{8 * cells:,} bytes: cut it, no unit's log is larger than a gigabyte"


def _partition(file: str, path: str) -> dict[str, str]:
    """What the folders between say, in the form NAME=VALUE."""
    folders = os.path.relpath(os.path.dirname(file), path if os.path.isdir(path) else os.path.dirname(path) or ".")
    pairs = (part.partition("=") for part in folders.split(os.sep) if "=" in part)
    return {name: unquote(value) for name, _, value in pairs}


def logs(wanted: Sequence[Entry], source: Source) -> Iterator[Log]:
    """The logs of some units, in their order; each row group is read once where neighbours share it."""
    tables = _Tables(source, {each.unit for each in wanted})
    for entry in wanted:
        labels = dict(entry.labels)
        if entry.reason is not None:
            yield Log(entry.unit, None, _group(labels, source), entry.reason)
            continue
        try:
            trace = _trace(entry, source, tables, labels)
            yield Log(entry.unit, trace, _group(labels, source), None)
        except Refused as refused:
            yield Log(entry.unit, None, _group(labels, source), _reason(refused))
        except (OSError, ValueError) as error:
            yield Log(entry.unit, None, _group(labels, source), f"cannot be read ({_first_line(error)})")


def _group(labels: dict[str, str], source: Source) -> tuple[str, ...]:
    return tuple(labels.get(name, UNKNOWN) for name in source.within)


def _reason(refused: Refused) -> str:
    return "; ".join(f"{each.place}: {each.problem}" if each.place else each.problem for each in refused.faults)


def _trace(entry: Entry, source: Source, tables: _Tables, labels: dict[str, str]) -> Trace:
    if not entry.pieces[0].path.endswith(_PARQUET):
        if len(entry.pieces) > 1:
            raise refuse(entry.unit, "", "two files have the name of this unit", "rename one")
        trace = load_trace(entry.pieces[0].path)
        labels.update({name: trace.notes[name] for name in source.within if name in trace.notes})
        return _checked(trace, source)
    frame = tables.frame(entry, labels)
    return _checked(frame_trace(frame, entry.unit), source)


def _checked(trace: Trace, source: Source) -> Trace:
    for name in source.columns or ():
        if not np.isfinite(trace.column(name)).any():
            raise refuse(trace.path, f"column {name}", "holds no value at all", "leave the unit out, or log it again")
    return trace


class _Tables:
    """Row groups as they are asked for, the last one kept: neighbours mostly share it."""

    def __init__(self, source: Source, units: set[str]) -> None:
        self._source = source
        self._units = units
        self._file: tuple[str, Any] = ("", None)
        self._group: tuple[Piece | None, Any] = (None, None)

    def frame(self, entry: Entry, labels: dict[str, str]) -> pd.DataFrame:
        """The rows of a unit; what stands in the columns of its groups goes to ``labels``."""
        import pandas as pd

        parts = [self._part(piece, entry.unit) for piece in entry.pieces]
        frame = pd.concat(parts, ignore_index=True) if len(parts) > 1 else parts[0]
        for name in self._source.within:
            if name in frame.columns and len(frame):
                labels[name] = str(frame[name].iloc[0])
        others = [name for name in (self._source.by, *self._source.within) if name in frame.columns]
        return frame.drop(columns=others)

    def _part(self, piece: Piece, unit: str) -> pd.DataFrame:
        if self._group[0] != piece:
            self._group = (piece, self._read(piece))
        frame = self._group[1]
        if self._source.by not in frame.columns:
            return frame
        return frame[frame[self._source.by] == unit]

    def _read(self, piece: Piece) -> pd.DataFrame:
        import pyarrow as pa
        import pyarrow.compute as pc

        if self._file[0] != piece.path:
            self._file = (piece.path, _opened(piece.path))
        opened = self._file[1]
        names = opened.schema_arrow.names
        wanted = [name for name in names if self._takes(name)]
        table = opened.read_row_group(piece.row_group, columns=wanted, use_threads=False)
        by = self._source.by
        if by in wanted:
            units = table.column(by).cast(pa.string())
            table = table.set_column(wanted.index(by), by, units)
            table = table.filter(pc.is_in(units, value_set=pa.array(sorted(self._units))))
        return table.to_pandas(use_threads=False)

    def _takes(self, name: str) -> bool:
        columns = self._source.columns
        if name in (TIME, self._source.by, *self._source.within):
            return True
        if name.startswith("__index"):
            return False
        return split_column(name) != ("", "") if columns is None else name in columns


def _opened(path: str) -> pq.ParquetFile:
    import pyarrow.parquet as pq

    return pq.ParquetFile(path)


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0][:200] or type(error).__name__


def write_dataset(
    folder: str, rows: Iterable[tuple[str, Trace, dict[str, str]]], by: str = "unit", each: int = 50
) -> int:
    """Write units (name, trace, labels) as a Parquet dataset, ``each`` a file, one row group a unit; their number.

    Raises :class:`Refused` where the folder holds something already.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    os.makedirs(folder, exist_ok=True)
    if os.listdir(folder):
        raise refuse(folder, "", "is not empty", "name a new folder for the dataset")
    writer, count = None, 0
    try:
        for unit, trace, labels in rows:
            length = len(trace.time_s)
            texts = {name: pa.array([text] * length).dictionary_encode() for name, text in {by: unit, **labels}.items()}
            table = pa.table({**texts, TIME: trace.time_s, **trace.columns})
            if writer is None or count % each == 0:
                if writer is not None:
                    writer.close()
                writer = pq.ParquetWriter(os.path.join(folder, f"part-{count // each:05d}.parquet"), table.schema)
            writer.write_table(table, row_group_size=max(length, 1))
            count += 1
    finally:
        if writer is not None:
            writer.close()
    return count
