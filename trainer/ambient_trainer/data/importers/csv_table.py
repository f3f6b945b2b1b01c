"""The rows and columns of a table of text that a column map asks for, each with the number of its line.

How cells are parted, what stands above the rows and which rows are left out is the map's to say.
"""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.data.importers.column_map import WHITESPACE, ColumnMap

UNREADABLE = "they cannot be read"
UNWANTED = "the map's 'drop_rows' names them"

_Row = tuple[int, list[str]]
"""A line's number and its cells."""


@dataclass(frozen=True)
class Table:
    """The columns of a file that a map asks for, as text; ``lines`` holds the line number of each row."""

    path: str
    lines: list[int]
    cells: dict[str, list[str]]
    dropped: dict[str, int]
    """How many rows were left out, by why."""

    def place(self, row: int, column: str) -> str:
        """Where the cell stands, for a message."""
        return f"line {self.lines[row]}, column {column}"


def read_table(path: str, column_map: ColumnMap, map_source: str) -> Table:
    """The table in the file at ``path``; raises :class:`~ambient_model.faults.Refused`, naming line or map entry."""
    line, header, rows = _named(path, _rows(path, column_map), column_map)
    asked = _asked(column_map)
    unwanted = {f"drop_rows.{name}": name for name in column_map.drop_rows}
    _check_asked(path, line, header, asked | unwanted, map_source)
    table = _taken(path, header, rows, list(asked.values()), column_map)
    if not table.lines and any(table.dropped.values()):
        said = "; ".join(f"{count} dropped since {why}" for why, count in table.dropped.items() if count)
        raise refuse(path, "", f"no row is left ({said})", "check 'drop_rows' and 'delimiter' in the map")
    if not table.lines:
        raise refuse(path, "", "no rows under the header", "log something first")
    return table


def _taken(path: str, header: list[str], rows: Iterator[_Row], names: list[str], column_map: ColumnMap) -> Table:
    """The columns ``names`` of the rows that fit the header and are wanted."""
    unwanted = [(header.index(name), frozenset(texts)) for name, texts in column_map.drop_rows.items()]
    table = Table(path, [], {name: [] for name in names}, {UNWANTED: 0, UNREADABLE: 0})
    takers = [(cells.append, header.index(name)) for name, cells in table.cells.items()]
    for line, row in rows:
        if len(row) != len(header) and (len(row) < len(header) or any(row[len(header) :])):
            if column_map.bad_rows == "refuse":
                raise refuse(
                    path,
                    f"line {line}",
                    f"{len(row)} cells where the header has {len(header)}",
                    "correct or remove the row; check 'delimiter' and 'decimal' in the map",
                )
            table.dropped[UNREADABLE] += 1
        elif any(row[index].strip() in texts for index, texts in unwanted):
            table.dropped[UNWANTED] += 1
        else:
            table.lines.append(line)
            for take, index in takers:
                take(row[index].strip())
    return table


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


def _rows(path: str, layout: ColumnMap) -> Iterator[_Row]:
    """Line number and cells of each row that is neither skipped, nor a comment, nor empty."""
    lines = _without_comments(io.StringIO(decoded(path, layout.encoding), newline=""), layout)
    if layout.delimiter == WHITESPACE:
        yield from ((number, line.split()) for number, line in enumerate(lines, 1) if line.strip())
        return
    rows = csv.reader(lines, delimiter=layout.delimiter)
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


def _named(path: str, rows: Iterator[_Row], layout: ColumnMap) -> tuple[int, list[str], Iterator[_Row]]:
    """The line of the names, the names, and the rows under it; 1, 2, 3, ... where the table has no names."""
    found = next(rows, None)
    if found is None:
        what = "header line" if layout.header else "row"
        raise refuse(path, "", f"no {what}", "check 'skip_rows' and 'comment', or the file: it may be empty")
    line, cells = found
    if not layout.header:
        return line, [str(number) for number in range(1, len(cells) + 1)], itertools.chain([found], rows)
    return line, [cell.strip() for cell in cells], itertools.islice(rows, layout.skip_under_header, None)


def _asked(column_map: ColumnMap) -> dict[str, str]:
    """The columns that become something, by the place in the map that asks for each."""
    asked = {"time.column": column_map.time.column}
    for name, source in column_map.columns.items():
        several = len(source.sources) > 1
        for index, each in enumerate(source.sources):
            asked[f"columns.{name}.from[{index}]" if several else f"columns.{name}.from"] = each
    return asked


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
