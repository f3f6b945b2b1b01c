"""A table of text becomes a trace through a column map; what cannot be read is refused by line and column."""

import csv
import io
import itertools
import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import LARGEST
from ambient_trainer.data.importers._column_map import WHITESPACE, ColumnMap, ColumnSource
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.data.units import to_base

Mask = NDArray[np.bool_]
_Row = tuple[int, list[str]]
"""A line's number and its cells."""

_UNREADABLE = "they cannot be read"
_UNWANTED = "the map's 'drop_rows' names them"
_NOT_INCREASING = "their time did not increase"
_LISTED = "correct it, or list it under 'missing' in the map"
_SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx and .ods, which are zip archives; .xls
_DATED = re.compile("%[YyGcx]|^iso$")
_SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_TIME_DIGITS, _VALUE_DIGITS = 6, 9
"""Microseconds; and what conversion between units leaves of a decimal number, without the rounding of binary ones."""


@dataclass(frozen=True)
class Imported:
    """Trace of an imported file, and how many rows were left out, by reason."""

    trace: Trace
    dropped: dict[str, int]

    @property
    def dropped_rows(self) -> int:
        """How many rows were left out in all."""
        return sum(self.dropped.values())


def import_table(path: str, column_map: ColumnMap, source: str) -> Imported:
    """Trace that a column map makes of a text table; its time starts at 0 with the first row.

    Raises :class:`Refused` with one fault for each column, by line; or with those of the map, which ``source`` names,
    that do not fit the table.
    """
    cells, dropped = _cells(path, column_map, source)
    reading = _Reading(path, cells, column_map)
    time_s, start = reading.time()
    columns = reading.columns()
    kept = reading.increasing(time_s)
    unreadable = int(reading.unreadable.sum())
    dropped[_UNREADABLE] += unreadable
    dropped[_NOT_INCREASING] = len(time_s) - int(kept.sum()) - unreadable
    dropped = {why: count for why, count in dropped.items() if count}
    taken = {name: values[kept] for name, values in columns.items()}
    taken.update({name: np.full(int(kept.sum()), value) for name, value in column_map.constants.items()})
    notes = {"source": os.path.basename(path)} | ({"start": start} if start else {})
    if dropped:
        notes["dropped_rows"] = str(sum(dropped.values()))
    if column_map.constants:
        assumed = ", ".join(f"{name} = {value:g}" for name, value in column_map.constants.items())
        notes["assumed"] = f"{assumed} (not logged)"
    return Imported(Trace(path, time_s[kept], taken, notes | column_map.notes), dropped)


def decoded(path: str, encoding: str | None) -> str:
    """The text of the file at ``path``: in ``encoding``, else UTF-16 where its first bytes say so, else UTF-8."""
    try:
        raw = Path(path).read_bytes()
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "check the name and the permissions") from error
    if raw.startswith(_SPREADSHEETS):
        raise refuse(path, "", "is a spreadsheet, or another archive, not text", "save it as CSV")
    chosen = encoding or ("utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig")
    try:
        return raw.decode(chosen)
    except UnicodeError as error:
        line = raw[: getattr(error, "start", 0)].count(b"\n") + 1
        hint = "name its encoding in the map, such as 'encoding: cp1252'"
        raise refuse(path, f"line {line}", f"is not {chosen.removesuffix('-sig')} text", hint) from error


def _cells(path: str, layout: ColumnMap, source: str) -> tuple[pd.DataFrame, dict[str, int]]:
    """The columns that the map asks for, as text by line, and how many rows were left out, by reason."""
    rows = _rows(path, layout)
    first = next(rows, None)
    if first is None:
        what = "header line" if layout.header else "row"
        raise refuse(path, "", f"no {what}", "check 'skip_rows' and 'comment', or the file: it may be empty")
    if layout.header:
        names = [cell.strip() for cell in first[1]]
        rows = itertools.islice(rows, layout.skip_under_header, None)
    else:
        names = [str(number) for number in range(1, len(first[1]) + 1)]
        rows = itertools.chain([first], rows)
    asked = layout.asked()
    _check_asked(path, first[0], names, asked, source)
    lines, kept, unreadable = [], [], 0
    for line, row in rows:
        if len(row) >= len(names) and not any(row[len(names) :]):
            lines.append(line)
            kept.append(row)
        elif layout.bad_rows == "drop":
            unreadable += 1
        else:
            problem = f"{len(row)} cells where the header has {len(names)}"
            hint = "correct or remove the row; check 'delimiter' and 'decimal' in the map"
            raise refuse(path, f"line {line}", problem, hint)
    places = {name: names.index(name) for name in asked.values()}
    table = pd.DataFrame({name: [row[at].strip() for row in kept] for name, at in places.items()}, lines, dtype=object)
    unwanted = np.zeros(len(table), dtype=bool)
    for name, texts in layout.drop_rows.items():
        unwanted |= table[name].isin(texts).to_numpy()
    dropped = {_UNWANTED: int(unwanted.sum()), _UNREADABLE: unreadable}
    if unwanted.all() and any(dropped.values()):
        counts = "; ".join(f"{count} dropped since {why}" for why, count in dropped.items() if count)
        raise refuse(path, "", f"no row is left ({counts})", "check 'drop_rows' and 'delimiter' in the map")
    if not len(table):
        raise refuse(path, "", "no rows under the header", "log something first")
    return table[~unwanted], dropped


def _rows(path: str, layout: ColumnMap) -> Iterator[_Row]:
    """Line number and cells of each row that is neither skipped, nor a comment, nor empty.

    An own loop, since pandas' reader says of no row in which line it stands.
    """
    lines = (
        # an empty line in place of what is skipped keeps the numbers those of the file
        "\n" if index < layout.skip_rows or (layout.comment and line.startswith(layout.comment)) else line
        for index, line in enumerate(io.StringIO(decoded(path, layout.encoding), newline=""))
    )
    if layout.delimiter == WHITESPACE:
        yield from ((number, line.split()) for number, line in enumerate(lines, 1) if line.strip())
        return
    rows = csv.reader(lines, delimiter=layout.delimiter)
    while True:
        try:
            cells = next(rows, None)
        except csv.Error as error:
            place, problem = f"line {rows.line_num}", f"not readable as CSV ({error})"
            raise refuse(path, place, problem, "correct the quotes") from error
        if cells is None:
            return
        if any(cells):
            yield rows.line_num, cells


def _check_asked(path: str, line: int, names: list[str], asked: dict[str, str], source: str) -> None:
    faults = []
    hint = f"line {line} has {', '.join(names)}"
    if len(names) == 1 and (parted := next((each for each in ";\t|" if each in names[0]), None)):
        hint += f": if these are several columns, say 'delimiter: {json.dumps(parted)}' in the map"
    for place, name in asked.items():
        if name not in names:
            faults.append(Fault(place, f"no column '{name}' in {path}", hint))
        elif names.count(name) > 1:
            faults.append(Fault(place, f"column '{name}' is duplicated in {path}", f"rename one in line {line}"))
    if faults:
        raise Refused(source, faults)


class _Reading:
    """The table's text as numbers; ``unreadable`` marks the rows to leave out, none where the map refuses them."""

    def __init__(self, path: str, cells: pd.DataFrame, column_map: ColumnMap) -> None:
        self.path = path
        times = column_map.time.columns
        self.time_column = " + ".join(times)
        self.cells = cells.assign(**{self.time_column: list(map(" ".join, zip(*(cells[each] for each in times))))})
        self.map = column_map
        self.unreadable: Mask = np.zeros(len(cells), dtype=bool)

    def _bad(self, rows: Mask, column: str, fault: Callable[[str], tuple[str, str]]) -> None:
        """Drop ``rows``, or refuse the first of them with the problem and the hint that ``fault`` makes of its text."""
        if self.map.bad_rows == "drop":
            self.unreadable |= rows
        elif rows.any():
            row = int(np.argmax(rows))
            place = f"line {self.cells.index[row]}, column {column}"
            raise refuse(self.path, place, *fault(self.cells[column].iloc[row]))

    def time(self) -> tuple[Array, str]:
        """Seconds since the first row, to the microsecond, and its time: an ISO date, seconds, or "" without a day."""
        source = self.map.time
        texts = self.cells[self.time_column].tolist()
        moments, wrong = _parsed(texts, lambda text: _moment(text, self.map))
        kind = f"the format {source.format!r}" if source.format else "a number"
        hint = "correct or remove the row, or describe the time otherwise in the map"
        self._bad(wrong, self.time_column, lambda text: (f"{text!r} is not {kind}", hint))
        first = int(np.argmax(np.isfinite(moments)))
        with np.errstate(over="ignore", invalid="ignore"):
            seconds = np.round((moments - moments[first]) * _SECONDS[source.unit or "s"], _TIME_DIGITS)
        problem = f"is no time to count from {texts[first]!r}"
        beyond = ~(np.abs(seconds) <= LARGEST)
        self._bad(beyond, self.time_column, lambda text: (f"{text!r} {problem}", "correct or remove the row"))
        if source.format and not _DATED.search(source.format):
            return seconds, ""
        if source.format and np.isfinite(moments[first]):
            return seconds, _date(texts[first], source.format).isoformat()
        return seconds, f"{moments[first] * _SECONDS[source.unit or 's']:.15g} s"

    def columns(self) -> dict[str, Array]:
        """Every column that the map makes of the table's; raises with the first fault of each."""
        faults: list[Fault] = []
        columns: dict[str, Array] = {}
        for name, source in self.map.columns.items():
            try:
                columns[name] = self._column(name, source)
            except Refused as refused:
                faults.extend(refused.faults)
        if faults:
            raise Refused(self.path, faults)
        return columns

    def increasing(self, time_s: Array) -> Mask:
        """Which rows to keep: those that can be read and are later than every such row before them."""
        rows = np.flatnonzero(~self.unreadable)
        if not len(rows):
            problem = f"no row is left ({len(time_s)} dropped since {_UNREADABLE})"
            raise refuse(self.path, "", problem, "import it with 'bad_rows: refuse' to see why")
        later = np.ones(len(rows), dtype=bool)
        later[1:] = time_s[rows[1:]] > np.maximum.accumulate(time_s[rows])[:-1]
        source = self.map.time
        if source.not_increasing == "refuse" and not later.all():
            index = int(np.argmin(later))
            before, text = self.cells[self.time_column].iloc[rows[[index - 1, index]]]
            dated = not source.format or _DATED.search(source.format)
            why = "was the clock set back?" if dated else "does the day change there? Name a column of the date too;"
            problem, lost = f"{text} does not come after {before}", f"leaves out {(~later).sum()} of {len(later)} rows"
            hint = f"{why} correct the rows; 'not_increasing: drop' in the map's 'time' {lost}"
            raise refuse(self.path, f"line {self.cells.index[rows[index]]}, column {self.time_column}", problem, hint)
        kept = np.zeros(len(time_s), dtype=bool)
        kept[rows[later]] = True
        return kept

    def _column(self, name: str, source: ColumnSource) -> Array:
        missing = {"", *self.map.missing, *source.missing}
        probes = np.stack([self._numbers(each, missing) for each in source.sources])
        with np.errstate(over="ignore", invalid="ignore"):
            if source.unit:
                probes = to_base(probes, source.unit)
            combined = probes[0] if source.combine is None else pd.DataFrame(probes).agg(source.combine).to_numpy()
            values: Array = combined * source.scale + source.offset
            if (source.unit, source.combine, source.scale, source.offset) != (None, None, 1.0, 0.0):
                values = np.round(values, _VALUE_DIGITS)
        beyond = ~(np.abs(values) <= LARGEST) & np.isfinite(probes).any(axis=0)
        hint = f"correct it, or list it under 'missing' in columns.{name}"
        self._bad(beyond, source.sources[0], lambda text: (f"{text!r} converts to no measurement", hint))
        return values

    def _numbers(self, column: str, missing: set[str]) -> Array:
        """The column's cells, NaN where missing: empty, NaN, or in ``missing`` as text or as the same number."""
        decimal = self.map.decimal
        texts = self.cells[column].tolist()
        values, wrong = _parsed(texts, lambda text: np.nan if text in missing else _number(text, decimal))
        comma = "if that is a decimal comma, say 'decimal: \",\"' in the map"
        hint = {True: comma, False: _LISTED}
        self._bad(wrong, column, lambda text: (f"{text!r} is not a number", hint[decimal == "." and "," in text]))
        sentinels, _ = _parsed(list(missing), float)
        values[np.isin(values, sentinels)] = np.nan
        self._bad(np.isinf(values), column, lambda text: (f"{text!r} is not a finite number", _LISTED))
        return values


def _parsed(texts: list[str], number: Callable[[str], float]) -> tuple[Array, Mask]:
    """What ``number`` makes of each text, and which it cannot read: NaN there."""

    def read(text: str) -> float | None:
        try:
            return number(text)
        except (ValueError, OverflowError):
            return None

    found = [read(text) for text in texts]
    return np.array(found, dtype=np.float64), np.array([each is None for each in found], dtype=bool)


def _moment(text: str, column_map: ColumnMap) -> float:
    """The time in its own unit; dates in seconds since 1970, UTC where no zone stands: only differences are used."""
    if column_map.time.format is None:
        return _number(text, column_map.decimal)
    moment = _date(text, column_map.time.format)
    return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()


def _date(text: str, pattern: str) -> datetime:
    if pattern == "iso":
        return datetime.fromisoformat(text.replace("Z", "+00:00"))
    return datetime.strptime(text, pattern)


def _number(text: str, decimal: str) -> float:
    if decimal == ",":
        if "." in text:
            raise ValueError("a point beside a decimal comma separates thousands, or is a mistake")
        text = text.replace(",", ".")
    return float(text)
