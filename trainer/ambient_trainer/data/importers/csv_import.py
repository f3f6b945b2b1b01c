"""A foreign CSV file becomes a trace through a column map; what cannot be read is refused by line and column."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import LARGEST
from ambient_trainer.data.importers.column_map import ColumnMap, ColumnSource
from ambient_trainer.data.importers.csv_table import UNREADABLE, Table, read_table
from ambient_trainer.data.trace import Trace
from ambient_trainer.data.units import to_base

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_TIME_DIGITS = 6
_VALUE_DIGITS = 9
_NOT_INCREASING = "their time did not increase"


@dataclass(frozen=True)
class Imported:
    """What came in."""

    trace: Trace
    dropped: dict[str, int]
    """How many rows were left out, by why."""

    @property
    def dropped_rows(self) -> int:
        """How many rows were left out in all."""
        return sum(self.dropped.values())


def import_csv(path: str, column_map: ColumnMap, map_source: str) -> Imported:
    """The trace that ``column_map`` makes of the CSV file at ``path``; its time starts at 0 with the first row.

    ``map_source`` names the map in messages. Raises :class:`~ambient_model.faults.Refused`: one fault a column.
    """
    reading = _Reading(read_table(path, column_map, map_source), column_map)
    time_s, start = reading.time()
    columns = reading.columns()
    kept = reading.increasing(time_s)
    dropped = dict(reading.table.dropped)
    dropped[UNREADABLE] += int(reading.unreadable.sum())
    dropped[_NOT_INCREASING] = len(time_s) - int(kept.sum()) - int(reading.unreadable.sum())
    dropped = {why: count for why, count in dropped.items() if count}
    taken = {name: values[kept] for name, values in columns.items()}
    taken.update({name: np.full(int(kept.sum()), value) for name, value in column_map.constants.items()})
    notes = _notes(path, start, dropped, column_map)
    return Imported(Trace(path, time_s[kept], taken, notes), dropped)


def _notes(path: str, start: str, dropped: dict[str, int], column_map: ColumnMap) -> dict[str, str]:
    notes = {"source": os.path.basename(path), "start": start}
    if dropped:
        notes["dropped_rows"] = str(sum(dropped.values()))
    if column_map.constants:
        assumed = [f"{name} = {value:g}" for name, value in column_map.constants.items()]
        notes["assumed"] = f"{', '.join(assumed)} (not logged)"
    return notes | column_map.notes


class _Reading:
    """The table's text as numbers; ``unreadable`` marks the rows to leave out, none where the map refuses them."""

    def __init__(self, table: Table, column_map: ColumnMap) -> None:
        self.table = table
        self.map = column_map
        self.unreadable: Mask = np.zeros(len(table.lines), dtype=bool)

    def _bad(self, rows: Mask, column: str, fault: Callable[[str], tuple[str, str]]) -> None:
        """Refuse the first of ``rows``, with the problem and the mend that ``fault`` says of its text, or drop all."""
        if self.map.bad_rows == "drop":
            self.unreadable |= rows
        elif rows.any():
            row = int(np.argmax(rows))
            problem, mend = fault(self.table.cells[column][row])
            raise refuse(self.table.path, self.table.place(row, column), problem, mend)

    def time(self) -> tuple[Array, str]:
        """Seconds since the first row, to the microsecond, and the first row's time as it is written."""
        source = self.map.time
        texts = self.table.cells[source.column]
        moments, wrong = _parsed(texts, lambda text: _moment(text, self.map))
        how = f"the format {source.format!r}" if source.format else "a number"
        mend = "correct or remove the row, or describe the time otherwise in the map"
        self._bad(wrong, source.column, lambda text: (f"{text!r} is not {how}", mend))
        first = int(np.argmax(np.isfinite(moments)))
        with np.errstate(over="ignore", invalid="ignore"):
            seconds = np.round((moments - moments[first]) * _SECONDS[source.unit or "s"], _TIME_DIGITS)
        none = f"is no time to count from {texts[first]!r}"
        beyond = ~(np.abs(seconds) <= LARGEST)
        self._bad(beyond, source.column, lambda text: (f"{text!r} {none}", "correct or remove the row"))
        return seconds, f"{texts[first]} {source.unit}" if source.unit else texts[first]

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
            raise Refused(self.table.path, faults)
        return columns

    def increasing(self, time_s: Array) -> Mask:
        """Which rows to keep: those that can be read and are later than every such row before them."""
        rows = np.flatnonzero(~self.unreadable)
        if not len(rows):
            problem = f"no row is left ({len(time_s)} dropped since {UNREADABLE})"
            raise refuse(self.table.path, "", problem, "import it with 'bad_rows: refuse' to see why")
        later = np.ones(len(rows), dtype=bool)
        later[1:] = time_s[rows[1:]] > np.maximum.accumulate(time_s[rows])[:-1]
        source = self.map.time
        if source.not_increasing == "refuse" and not later.all():
            index = int(np.argmin(later))
            before, row = rows[index - 1], rows[index]
            texts = self.table.cells[source.column]
            raise refuse(
                self.table.path,
                self.table.place(row, source.column),
                f"{texts[row]} does not come after {texts[before]} (rows out of order: {int((~later).sum())})",
                "correct the rows, or drop them with 'not_increasing: drop' in the map's 'time'",
            )
        kept = np.zeros(len(time_s), dtype=bool)
        kept[rows[later]] = True
        return kept

    def _column(self, name: str, source: ColumnSource) -> Array:
        missing = {"", *self.map.missing, *source.missing}
        probes = np.stack([self._numbers(each, missing) for each in source.sources])
        with np.errstate(over="ignore", invalid="ignore"):
            if source.unit:
                probes = to_base(probes, source.unit)
            values = _combined(probes, source.combine) * source.scale + source.offset
            if (source.unit, source.combine, source.scale, source.offset) != (None, None, 1.0, 0.0):
                values = np.round(values, _VALUE_DIGITS)
        beyond = ~(np.abs(values) <= LARGEST) & np.isfinite(probes).any(axis=0)
        mend = f"correct it, or list it under 'missing' in columns.{name}"
        self._bad(beyond, source.sources[0], lambda text: (f"{text!r} converts to no measurement", mend))
        return values

    def _numbers(self, column: str, missing: set[str]) -> Array:
        """The column's cells, NaN where missing: empty, NaN, or in ``missing`` as text or as the same number."""
        decimal = self.map.decimal
        texts = self.table.cells[column]
        values, wrong = _parsed(texts, lambda text: np.nan if text in missing else _number(text, decimal))
        self._bad(wrong, column, lambda text: (f"{text!r} is not a number", _mend_number(text, decimal)))
        values[np.isin(values, list(_as_numbers(missing)))] = np.nan
        mend = "correct it, or list it under 'missing' in the map"
        self._bad(np.isinf(values), column, lambda text: (f"{text!r} is not a finite number", mend))
        return values


def _parsed(texts: list[str], number: Callable[[str], float]) -> tuple[Array, Mask]:
    """What ``number`` makes of each text, and which it cannot read: NaN there."""
    values = np.full(len(texts), np.nan)
    wrong = np.zeros(len(texts), dtype=bool)
    for row, text in enumerate(texts):
        try:
            values[row] = number(text)
        except (ValueError, OverflowError):
            wrong[row] = True
    return values, wrong


def _moment(text: str, column_map: ColumnMap) -> float:
    """The time in its own unit; raises ValueError or OverflowError where it is none."""
    source = column_map.time
    return _clock(text, source.format) if source.format else _number(text, column_map.decimal)


def _clock(text: str, pattern: str) -> float:
    """Seconds since 1970; a time without a zone counts as UTC, since only differences are used."""
    if pattern == "iso":
        moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
    else:
        moment = datetime.strptime(text, pattern)
    return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()


def _combined(probes: Array, combine: str | None) -> Array:
    """One value a row from those probes, of shape (n, rows), that have one; NaN where none has."""
    if combine is None:
        return np.asarray(probes[0])
    values = np.full(probes.shape[1], np.nan)
    some = ~np.isnan(probes).all(axis=0)
    values[some] = (np.nanmean if combine == "mean" else np.nanmedian)(probes[:, some], axis=0)
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
