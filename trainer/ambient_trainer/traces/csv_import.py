"""A foreign CSV file becomes a trace through a column map; what cannot be read is refused by line and column."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.traces.column_map import ColumnMap, ColumnSource, TimeSource
from ambient_trainer.traces.trace import Trace
from ambient_trainer.traces.units import to_base

Array = NDArray[np.float64]

_SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_TIME_DIGITS = 6
_VALUE_DIGITS = 9


@dataclass(frozen=True)
class Imported:
    """What came in."""

    trace: Trace
    dropped_rows: int
    """Rows left out because their time did not increase."""


@dataclass(frozen=True)
class _Table:
    """The columns of a file that a map asks for, as text; ``lines`` holds the line number of each row."""

    path: str
    lines: list[int]
    cells: dict[str, list[str]]

    def place(self, row: int, column: str) -> str:
        return f"line {self.lines[row]}, column {column}"


def import_csv(path: str, column_map: ColumnMap, map_source: str) -> Imported:
    """The trace that ``column_map`` makes of the CSV file at ``path``; its time starts at 0 with the first row.

    ``map_source`` names the map in messages. Raises :class:`~ambient_model.faults.Refused`: one fault a column.
    """
    table = _read_table(path, column_map, map_source)
    time_s, start = _time(table, column_map)
    kept = _increasing(table, column_map.time, time_s)
    faults: list[Fault] = []
    columns: dict[str, Array] = {}
    for name, source in column_map.columns.items():
        try:
            columns[name] = _column(table, column_map, name, source)[kept]
        except Refused as refused:
            faults.extend(refused.faults)
    if faults:
        raise Refused(path, faults)
    dropped = len(time_s) - int(kept.sum())
    notes = {"source": os.path.basename(path), "start": start}
    if dropped:
        notes["dropped_rows"] = str(dropped)
    return Imported(Trace(path, time_s[kept], columns, notes), dropped)


def decoded(path: str, encoding: str | None) -> str:
    """The text of the file at ``path``: in ``encoding``, else UTF-16 where its first bytes say so, else UTF-8."""
    try:
        raw = Path(path).read_bytes()
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "check the name and the permissions") from error
    chosen = encoding or ("utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig")
    try:
        return raw.decode(chosen)
    except UnicodeError as error:
        line = raw[: getattr(error, "start", 0)].count(b"\n") + 1
        raise refuse(
            path, f"line {line}", f"is not {chosen} text", "name its encoding in the map, such as 'encoding: cp1252'"
        ) from error


def _rows(path: str, layout: ColumnMap) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row that is neither skipped, nor a comment, nor empty."""
    lines = io.StringIO(decoded(path, layout.encoding), newline="")
    rows = csv.reader(_without_comments(lines, layout), delimiter=layout.delimiter)
    while True:
        try:
            cells = next(rows, None)
        except csv.Error as error:
            raise refuse(
                path, f"line {rows.line_num}", f"not readable as CSV ({error})", "correct the quotes"
            ) from error
        if cells is None:
            return
        if any(cells):
            yield rows.line_num, cells


def _without_comments(lines: Iterator[str], layout: ColumnMap) -> Iterator[str]:
    """Empty lines in place of what is skipped, so that line numbers stay those of the file."""
    for index, line in enumerate(lines):
        hidden = index < layout.skip_rows or (layout.comment and line.startswith(layout.comment))
        yield "\n" if hidden else line


def _header(path: str, rows: Iterator[tuple[int, list[str]]]) -> tuple[int, list[str]]:
    for line, cells in rows:
        return line, [cell.strip() for cell in cells]
    raise refuse(path, "", "no header line", "check 'skip_rows' and 'comment', or the file: it may be empty")


def _read_table(path: str, column_map: ColumnMap, map_source: str) -> _Table:
    rows = _rows(path, column_map)
    header_line, header = _header(path, rows)
    asked = {"time.column": column_map.time.column}
    for name, source in column_map.columns.items():
        several = len(source.sources) > 1
        for index, each in enumerate(source.sources):
            asked[f"columns.{name}.from[{index}]" if several else f"columns.{name}.from"] = each
    _check_asked(path, header_line, header, asked, map_source)
    indexes = {name: header.index(name) for name in asked.values()}
    lines: list[int] = []
    cells: dict[str, list[str]] = {name: [] for name in indexes}
    takers = [(values.append, indexes[name]) for name, values in cells.items()]
    for line, row in rows:
        if len(row) != len(header) and (len(row) < len(header) or any(row[len(header) :])):
            raise refuse(
                path,
                f"line {line}",
                f"{len(row)} cells where the header has {len(header)}",
                "correct or remove the row; check 'delimiter' and 'decimal' in the map",
            )
        lines.append(line)
        for take, index in takers:
            take(row[index].strip())
    if not lines:
        raise refuse(path, "", "no rows under the header", "log something first")
    return _Table(path, lines, cells)


def _check_asked(path: str, line: int, header: list[str], asked: dict[str, str], map_source: str) -> None:
    faults = []
    for place, name in asked.items():
        if header.count(name) != 1:
            known = ", ".join(header)
            problem = f"no column '{name}'" if name not in header else f"column '{name}' stands twice"
            mend = f"line {line} has {known}" if name not in header else f"rename one in line {line}"
            faults.append(Fault(place, f"{problem} in {path}", mend))
    if faults:
        raise Refused(map_source, faults)


def _time(table: _Table, column_map: ColumnMap) -> tuple[Array, str]:
    """Seconds since the first row, to the microsecond, and the first row's time as it is written."""
    source = column_map.time
    texts = table.cells[source.column]
    seconds = np.empty(len(texts))
    for row, text in enumerate(texts):
        try:
            seconds[row] = _clock(text, source.format) if source.format else _number(text, column_map.decimal)
        except (ValueError, OverflowError):
            how = f"the format {source.format!r}" if source.format else "a number"
            mend = "correct or remove the row, or describe the time otherwise in the map"
            raise refuse(table.path, table.place(row, source.column), f"{text!r} is not {how}", mend) from None
    with np.errstate(over="ignore", invalid="ignore"):
        seconds = np.round((seconds - seconds[0]) * _SECONDS[source.unit or "s"], _TIME_DIGITS)
    if not np.isfinite(seconds).all():
        row = int(np.argmin(np.isfinite(seconds)))
        problem = f"{texts[row]!r} is no time to count from {texts[0]!r}"
        raise refuse(table.path, table.place(row, source.column), problem, "correct or remove the row")
    return seconds, f"{texts[0]} {source.unit}" if source.unit else texts[0]


def _clock(text: str, pattern: str) -> float:
    """Seconds since 1970; a time without a zone counts as UTC, since only differences are used."""
    if pattern == "iso":
        moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
    else:
        moment = datetime.strptime(text, pattern)
    return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()


def _increasing(table: _Table, source: TimeSource, time_s: Array) -> NDArray[np.bool_]:
    """Which rows to keep: those later than every row before them."""
    kept = np.ones(len(time_s), dtype=bool)
    kept[1:] = time_s[1:] > np.maximum.accumulate(time_s)[:-1]
    if source.not_increasing == "refuse" and not kept.all():
        row = int(np.argmin(kept))
        texts = table.cells[source.column]
        raise refuse(
            table.path,
            table.place(row, source.column),
            f"{texts[row]} does not come after {texts[row - 1]} (rows out of order: {int((~kept).sum())})",
            "correct the rows, or drop them with 'not_increasing: drop' in the map's 'time'",
        )
    return kept


def _column(table: _Table, column_map: ColumnMap, name: str, source: ColumnSource) -> Array:
    missing = {"", *column_map.missing, *source.missing}
    probes = np.stack([_numbers(table, each, missing, column_map.decimal) for each in source.sources])
    with np.errstate(over="ignore", invalid="ignore"):
        if source.unit:
            probes = to_base(probes, source.unit)
        values = _combined(probes, source.combine) * source.scale + source.offset
        if (source.unit, source.combine, source.scale, source.offset) != (None, None, 1.0, 0.0):
            values = np.round(values, _VALUE_DIGITS)
    beyond = ~np.isfinite(values) & np.isfinite(probes).any(axis=0)
    if beyond.any():
        row = int(np.argmax(beyond))
        text = table.cells[source.sources[0]][row]
        mend = f"correct it, or list it under 'missing' in columns.{name}"
        raise refuse(table.path, table.place(row, source.sources[0]), f"{text!r} converts to no finite number", mend)
    return values


def _combined(probes: Array, combine: str | None) -> Array:
    """One value a row from those probes, of shape (n, rows), that have one; NaN where none has."""
    if combine is None:
        return np.asarray(probes[0])
    values = np.full(probes.shape[1], np.nan)
    some = ~np.isnan(probes).all(axis=0)
    values[some] = (np.nanmean if combine == "mean" else np.nanmedian)(probes[:, some], axis=0)
    return values


def _numbers(table: _Table, column: str, missing: set[str], decimal: str) -> Array:
    """The column's cells, NaN where they are missing: empty, NaN, or in ``missing`` as text or as the same number."""
    texts = table.cells[column]
    values = np.empty(len(texts))
    for row, text in enumerate(texts):
        try:
            values[row] = np.nan if text in missing else _number(text, decimal)
        except ValueError:
            problem = f"{text!r} is not a number"
            raise refuse(table.path, table.place(row, column), problem, _mend_number(text, decimal)) from None
    values[np.isin(values, list(_as_numbers(missing)))] = np.nan
    if np.isinf(values).any():
        row = int(np.argmax(np.isinf(values)))
        mend = "correct it, or list it under 'missing' in the map"
        raise refuse(table.path, table.place(row, column), f"{texts[row]!r} is not a finite number", mend)
    return values


def _number(text: str, decimal: str) -> float:
    if decimal == ",":
        if "." in text:
            raise ValueError("a point beside a decimal comma separates thousands, or is a mistake")
        text = text.replace(",", ".")
    return float(text)


def _as_numbers(texts: set[str]) -> Iterator[float]:
    for text in texts:
        try:
            yield float(text)
        except ValueError:
            continue


def _mend_number(text: str, decimal: str) -> str:
    if decimal == "." and "," in text:
        return "if that is a decimal comma, say 'decimal: \",\"' in the map"
    return "correct it, or list it under 'missing' in the map"
