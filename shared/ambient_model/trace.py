"""A trace is CSV: a ``time_s`` that increases, ``<name>_<unit>`` columns, empty for missing, ``# key: value`` on top.

Read and written here only. A missing value is ``None``, never a number; what is not a finite number is refused.
"""

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import IO, NamedTuple

from ambient_model.atomic import replacing
from ambient_model.faults import Refused, refuse

TIME = "time_s"
REFERENCE = "ambient_degC"


class Header(NamedTuple):
    """What stands above the first row."""

    columns: tuple[str, ...]
    """Column names without ``time_s``, in file order."""
    notes: dict[str, str]
    """The ``# key: value`` lines."""


class Row(NamedTuple):
    """One sample."""

    time_s: float
    values: tuple[float | None, ...]
    """One per column of the header; ``None`` where the cell is empty."""


class TraceReader:
    """A trace file, read once from front to back in constant memory.

    Iterating yields :class:`Row`. Raises :class:`~ambient_model.faults.Refused`, naming line and column, for anything
    the contract does not allow.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._stream = _open(path)
        try:
            self._rows = csv.reader(self._stream, strict=True)
            self._line = 0
            self.header = self._read_header()
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> "TraceReader":
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def _next(self) -> list[str] | None:
        try:
            cells = next(self._rows)
        except StopIteration:
            return None
        except (csv.Error, UnicodeDecodeError, EOFError, OSError) as error:
            # gzip raises EOFError on a cut file and OSError on one that is not gzip at all
            raise self._refuse(
                f"line {self._line + 1}", f"not readable as CSV text ({error})", "save it as UTF-8 CSV"
            ) from error
        self._line = self._rows.line_num
        return cells

    def _refuse(self, place: str, problem: str, mend: str) -> Refused:
        return refuse(self.path, place, problem, mend)

    def _read_header(self) -> Header:
        notes: dict[str, str] = {}
        while True:
            cells = self._next()
            if cells is None:
                raise self._refuse(
                    "", "the file is empty", f"a trace starts with a header line '{TIME},<name>_<unit>,...'"
                )
            if not cells:
                continue
            if cells[0].startswith("#"):
                key, _, value = ",".join(cells).lstrip("# ").partition(":")
                notes[key.strip()] = value.strip()
                continue
            return Header(self._check_columns([cell.strip() for cell in cells]), notes)

    def _check_columns(self, names: list[str]) -> tuple[str, ...]:
        place = f"line {self._line}"
        if names[0].lstrip("\ufeff") != TIME:
            raise self._refuse(
                place,
                f"the first column is {names[0]!r}, not '{TIME}'",
                "put the time in seconds first, or use 'ambient-trainer import'",
            )
        for name in names[1:]:
            stem, _, unit = name.partition("_")
            if not stem or not unit:
                raise self._refuse(place, f"column {name!r} names no unit", "name it <name>_<unit>, such as usb_degC")
            if names.count(name) > 1:
                raise self._refuse(place, f"column {name!r} stands twice", "rename or remove one")
        return tuple(names[1:])

    def __iter__(self) -> Iterator[Row]:
        width = len(self.header.columns) + 1
        before = -math.inf
        while (cells := self._next()) is not None:
            if not cells:
                continue
            if len(cells) != width:
                raise self._refuse(
                    f"line {self._line}",
                    f"{len(cells)} cells where the header has {width}",
                    "fill or cut the row; an empty cell is a missing value",
                )
            try:
                numbers = [float(cell) if cell else None for cell in cells]
            except ValueError:
                numbers = [self._number(cell, index) for index, cell in enumerate(cells)]
            if not all([math.isfinite(number) for number in numbers if number is not None]):
                raise self._not_finite(cells)
            time_s = numbers[0]
            if time_s is None:
                raise self._refuse(f"line {self._line}, column {TIME}", "no time", "every row needs one")
            if time_s <= before:
                raise self._refuse(
                    f"line {self._line}, column {TIME}",
                    f"{time_s:g} s does not come after {before:g} s",
                    "sort the rows and drop doubles: time must increase",
                )
            before = time_s
            yield Row(time_s, tuple(numbers[1:]))

    def _number(self, cell: str, index: int) -> float | None:
        try:
            return float(cell) if cell.strip() else None
        except ValueError:
            raise self._refuse(
                self._place(index),
                f"{cell!r} is not a number",
                "correct it, or leave the cell empty for a missing value",
            ) from None

    def _not_finite(self, cells: list[str]) -> Refused:
        index = next(index for index, cell in enumerate(cells) if cell and not math.isfinite(float(cell)))
        return self._refuse(
            self._place(index), f"{cells[index]!r} is not a finite number", "leave the cell empty for a missing value"
        )

    def _place(self, index: int) -> str:
        return f"line {self._line}, column {(TIME, *self.header.columns)[index]}"


def _open(path: str) -> IO[str]:
    try:
        if path.endswith(".gz"):
            import gzip

            return gzip.open(path, "rt", encoding="utf-8", newline="")
        return open(path, encoding="utf-8", newline="")
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "check the name and the permissions") from error


def write_trace(
    path: str,
    columns: Sequence[str],
    rows: Iterable[tuple[float, Sequence[float | None]]],
    notes: dict[str, str] | None = None,
) -> int:
    """Write a trace, whole or not at all, and return the number of rows.

    ``columns`` excludes ``time_s``; each row is its time in s and one value per column. Numbers are written with the
    fewest digits that read back as the same number. Raises :class:`~ambient_model.faults.Refused` as
    :func:`~ambient_model.atomic.replacing` does.
    """
    count = 0
    with replacing(path, "gz" if path.endswith(".gz") else "w") as stream:
        for key, value in (notes or {}).items():
            stream.write(f"# {key}: {value}\n")
        stream.write(",".join([TIME, *columns]) + "\n")
        for time_s, values in rows:
            stream.write(",".join([repr(time_s), *["" if value is None else repr(value) for value in values]]) + "\n")
            count += 1
    return count
