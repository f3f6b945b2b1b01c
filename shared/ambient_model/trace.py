"""A trace is CSV: a ``time_s`` that increases, ``<name>_<unit>`` columns, empty for missing, ``# key: value`` on top.

Read and written here only. A missing value is ``None``, never a number; what is not a finite number is refused, and so
is one that instruments give instead of a value.
"""

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import IO, NamedTuple, TypeVar

from ambient_model.atomic import replacing
from ambient_model.faults import Refused, refuse
from ambient_model.intake import first_double

TIME = "time_s"
REFERENCE = "ambient_degC"
LARGEST = 1e30
"""An open thermocouple reads 9.9e37, and sums of squares of larger numbers overflow."""
_LONGEST_LINE = 2**20
FLOW_UNITS = ("kg_s", "kg_h", "g_s", "l_s", "l_min", "l_h", "L_s", "L_min", "L_h", "m3_s", "m3_min", "m3_h")
_UNITS_OF_TWO = ("kW_m2", "W_m2", "m_s", "km_h", "rad_s", *FLOW_UNITS)

_Read = TypeVar("_Read")

_UNDECODED = frozenset(map(chr, range(0xDC80, 0xDD00)))
"""What a byte that is not UTF-8 is read as, so that it is refused in its own line."""


def split_column(column: str) -> tuple[str, str]:
    """The name and the unit of a trace column; ("", "") where it is not ``<name>_<unit>``.

    The unit is what follows the last underscore, or one of those that hold one: ``cpu_power_W`` is a cpu_power in W,
    ``irradiance_W_m2`` an irradiance in W_m2.
    """
    for unit in _UNITS_OF_TWO:
        if column.endswith(f"_{unit}"):
            name = column[: -len(unit) - 1]
            return (name, unit) if name else ("", "")
    name, _, unit = column.rpartition("_")
    return (name, unit) if name and unit else ("", "")


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
        self._lines = _lines(self._stream)
        self._line = 0
        try:
            self.header = self._read_header()
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> "TraceReader":
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def _next(self, source: Iterator[_Read]) -> _Read | None:
        try:
            return next(source, None)
        except csv.Error as error:
            raise self._refuse(f"line {self._line + 1}", f"not CSV ({error})", "save it as UTF-8 CSV") from error
        except _unreadable() as error:
            place = f"after line {self._line}" if self._line else ""
            raise self._refuse(place, f"cannot be read ({error})", "cut off or damaged? copy it again") from error

    def _refuse(self, place: str, problem: str, hint: str) -> Refused:
        return refuse(self.path, place, problem, hint)

    def _read_header(self) -> Header:
        notes: dict[str, str] = {}
        while (line := self._next(self._lines)) is not None:
            if not line.isascii() and _UNDECODED & set(line):
                raise self._refuse(f"line {self._line + 1}", "not UTF-8 text", "save it as UTF-8 CSV")
            if line.startswith("#"):  # free text, in which a quote is only a quote
                key, _, value = line.lstrip("# ").partition(":")
                notes[key.strip()] = value.strip()
            elif line.strip():
                cells = self._next(csv.reader([line], strict=True)) or []
                self._line += 1
                return Header(self._check_columns([cell.strip() for cell in cells]), notes)
            self._line += 1
        raise self._refuse("", "the file is empty", f"a trace starts with a header line '{TIME},<name>_<unit>,...'")

    def _check_columns(self, names: list[str]) -> tuple[str, ...]:
        place = f"line {self._line}"
        if names[0] != TIME:
            raise self._refuse(
                place,
                f"the first column is {names[0]!r}, not '{TIME}'",
                "put the time in seconds first, or use 'ambient-trainer import'",
            )
        _check_names(self.path, place, names)
        return tuple(names[1:])

    def __iter__(self) -> Iterator[Row]:
        width = len(self.header.columns) + 1
        before = -math.inf
        rows = csv.reader(self._lines, strict=True)
        above = self._line
        while (cells := self._next(rows)) is not None:
            self._line = above + rows.line_num
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
            if not all([abs(number) <= LARGEST for number in numbers if number is not None]):
                raise self._no_measurement(cells, numbers)
            time_s = numbers[0]
            if time_s is None:
                raise self._refuse(f"line {self._line}, column {TIME}", "no time", "every row needs one")
            if time_s <= before:
                raise self._refuse(
                    f"line {self._line}, column {TIME}",
                    f"{time_s:.15g} s does not come after {before:.15g} s",
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

    def _no_measurement(self, cells: list[str], numbers: list[float | None]) -> Refused:
        index = next(k for k, number in enumerate(numbers) if number is not None and not abs(number) <= LARGEST)
        what = "is beyond any measurement" if math.isfinite(numbers[index] or 0.0) else "is not a finite number"
        return self._refuse(self._place(index), f"{cells[index]!r} {what}", "leave the cell empty for a missing value")

    def _place(self, index: int) -> str:
        return f"line {self._line}, column {(TIME, *self.header.columns)[index]}"


def _open(path: str) -> IO[str]:
    try:
        if path.endswith(".gz"):
            import gzip

            return gzip.open(path, "rt", encoding="utf-8-sig", errors="surrogateescape", newline="")
        return open(path, encoding="utf-8-sig", errors="surrogateescape", newline="")
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "check the name and the permissions") from error


def _lines(stream: IO[str]) -> Iterator[str]:
    """The lines of ``stream``; raises csv.Error for one that does not end, as a device's."""
    readline = stream.readline
    while line := readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise csv.Error(f"a line of more than {_LONGEST_LINE} characters")
        yield line


def _unreadable() -> tuple[type[Exception], ...]:
    """What reading raises: gzip EOFError on a cut file, OSError on one of another kind, zlib.error on a damaged one."""
    import zlib  # asked for on failure only

    return (EOFError, OSError, zlib.error)


def _check_names(source: str, place: str, names: Sequence[str]) -> None:
    for name in names:
        if split_column(name) == ("", ""):
            raise refuse(source, place, f"column {name!r} names no unit", "name it <name>_<unit>, such as usb_degC")
        if not name.isprintable() or "," in name or '"' in name:
            raise refuse(
                source, place, f"column {name!r} holds a comma, a quote or a control character", "rename it without"
            )
    if (double := first_double(names)) is not None:
        raise refuse(source, place, f"column {double!r} is duplicated", "rename or remove one")


def write_trace(
    path: str,
    columns: Sequence[str],
    rows: Iterable[tuple[float, Sequence[float | None]]],
    notes: dict[str, str] | None = None,
) -> int:
    """Write a trace, whole or not at all, and return the number of rows.

    ``columns`` excludes ``time_s``; each row is its time in s and one value per column. Numbers are written with the
    fewest digits that read back as the same number. Raises :class:`~ambient_model.faults.Refused` as
    :func:`~ambient_model.atomic.replacing` does, and for what :class:`TraceReader` would not read back.
    """
    _check_names(path, "header", [TIME, *columns])
    count = 0
    before = -math.inf
    with replacing(path, "gz" if path.endswith(".gz") else "w") as stream:
        for key, value in (notes or {}).items():
            stream.write(" ".join(f"# {key}: {value}".splitlines()) + "\n")
        stream.write(",".join([TIME, *columns]) + "\n")
        for time_s, values in rows:
            numbers = [float(time_s), *[value if value is None else float(value) for value in values]]
            if (
                len(values) != len(columns)
                or not time_s > before
                or not all([abs(number) <= LARGEST for number in numbers if number is not None])
            ):
                raise refuse(
                    path,
                    f"row {count + 1}",
                    f"{numbers} is no sample of {len(columns)} values after {before:.15g} s",
                    "time increases, and what is not a finite number, or a huge one, is missing: nothing was written",
                )
            stream.write(",".join(["" if number is None else repr(number) for number in numbers]) + "\n")
            before = time_s
            count += 1
    return count
