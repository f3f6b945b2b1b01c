"""A column map is a YAML file that says which columns of a foreign table become which columns of a trace.

Its keys stand in the documentation, ``how-to/import.md``. A value is converted from ``unit`` to the unit that the trace
column's name ends with, then multiplied by ``scale``, then raised by ``offset``. Without names, ``header: false``, the
table's columns are called 1, 2, 3, ...
"""

import codecs
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, StrictBool, model_validator

from ambient_model.faults import Fault
from ambient_model.trace import LARGEST, split_column
from ambient_trainer.data.strict_yaml import Strict, holds, validated, wrong
from ambient_trainer.data.units import BASES, target_unit


def _text(value: Any) -> Any:
    if isinstance(value, bool) or value is None:
        raise wrong(f"YAML reads {value!r} here, not text", "put it in quotes")
    return str(value) if isinstance(value, int | float) else value


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _columns(columns: Any) -> Any:
    if columns in (None, {}):
        raise wrong("no columns", "map at least one, such as 'usb_degC: T_usb'")
    return columns


def _encoding(encoding: str | None) -> str | None:
    try:
        "".encode(encoding or "utf-8")
        codecs.lookup(encoding or "utf-8")
    except (LookupError, ValueError):
        raise wrong(f"no encoding is called {encoding!r}", "take utf-8, utf-16, cp1252 or latin-1") from None
    return encoding


def _notes(notes: dict[str, str]) -> dict[str, str]:
    for key, text in notes.items():
        if key in OWN_NOTES:
            raise wrong(f"'{key}' is a note that the import writes", "call it otherwise")
        if not key or ":" in key or key != key.strip("# ") or not (key + text).isprintable():
            raise wrong(f"{key!r} is no note", "give a key without ':' or '#', and one line of text")
    return notes


WHITESPACE = "whitespace"
"""The delimiter of a table whose cells are parted by runs of blanks."""
OWN_NOTES = ("source", "start", "dropped_rows", "assumed")
"""The notes that an import itself writes into a trace."""
_NO_DELIMITERS = ('"', "\r", "\n", "\0")
Text = Annotated[str, BeforeValidator(_text)]
Texts = Annotated[tuple[Text, ...], BeforeValidator(_as_list)]
_UNIT = holds(
    lambda unit: unit in BASES,
    "no unit is called {!r}",
    f"take one of {', '.join(BASES)}, or give 'scale' and 'offset'",
)
_SCALE = holds(bool, "a scale of 0 leaves nothing of the value", "give another, or leave the column out")
_DELIMITER = holds(
    lambda text: text == WHITESPACE or (len(text) == 1 and text not in _NO_DELIMITERS),
    "{!r} is no delimiter",
    f"give one character, or '{WHITESPACE}' for runs of blanks",
)
_CONSTANT = holds(lambda value: abs(value) <= LARGEST, "it is {:g}", "give what an instrument could read")


class TimeSource(Strict):
    """Where the time stands and how: a number in ``unit``, or text in ``format``, of several columns with blanks."""

    columns: Annotated[Texts, Field(alias="column", min_length=1)]
    unit: Literal["ns", "us", "ms", "s", "min", "h"] | None = None
    format: str | None = None
    not_increasing: Literal["refuse", "drop"] = "refuse"

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if (self.unit is None) == (self.format is None):
            problem = "neither 'unit' nor 'format'" if self.unit is None else "both 'unit' and 'format'"
            yield problem, "give 'unit: s' for a number, or 'format: \"%Y-%m-%d %H:%M:%S\"' for a date"
        if self.unit and len(self.columns) > 1:
            yield "a number in several columns", "name one, or give 'format' for a date and a time"


class ColumnSource(Strict):
    """Where one trace column comes from."""

    sources: Annotated[tuple[Text, ...], Field(alias="from", min_length=1), BeforeValidator(_as_list)]
    combine: Literal["mean", "median"] | None = None
    unit: Annotated[str | None, _UNIT] = None
    scale: Annotated[float, _SCALE] = 1.0
    offset: float = 0.0
    missing: tuple[Text, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"from": value}

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if (len(self.sources) > 1) != (self.combine is not None):
            one = len(self.sources) == 1
            problem = "'combine' with a single column" if one else f"{len(self.sources)} columns and no 'combine'"
            yield problem, "remove it" if one else "add 'combine: mean' or 'combine: median'"


class ColumnMap(Strict):
    """The whole file. ``missing`` counts for all columns, beside empty cells and NaN."""

    time: TimeSource
    columns: Annotated[dict[Text, ColumnSource], BeforeValidator(_columns)]
    constants: dict[Text, Annotated[float, _CONSTANT]] = Field(default_factory=dict)
    missing: tuple[Text, ...] = ()
    delimiter: Annotated[str, _DELIMITER] = ","
    decimal: Literal[".", ","] = "."
    header: StrictBool = True
    skip_rows: int = Field(0, ge=0)
    skip_under_header: int = Field(0, ge=0)
    drop_rows: dict[Text, Texts] = Field(default_factory=dict)
    bad_rows: Literal["refuse", "drop"] = "refuse"
    notes: Annotated[dict[Text, Text], AfterValidator(_notes)] = Field(default_factory=dict)
    comment: str | None = Field(None, min_length=1)
    encoding: Annotated[str | None, AfterValidator(_encoding)] = None

    def asked(self) -> dict[str, str]:
        """The columns of the table that are read, by the place in the map that asks for each."""
        named = {f"columns.{name}.from": source.sources for name, source in self.columns.items()}
        asked = {}
        for place, sources in {"time.column": self.time.columns, **named}.items():
            for index, each in enumerate(sources):
                asked[f"{place}[{index}]" if len(sources) > 1 else place] = each
        return asked | {f"drop_rows.{name}": name for name in self.drop_rows}

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if self.skip_under_header and not self.header:
            yield "'skip_under_header' without a header", "count those lines in 'skip_rows'"
        if self.delimiter == self.decimal:
            yield f"{self.decimal!r} is both delimiter and decimal", "give 'delimiter: \";\"'"


def parse_map(data: Any, source: str, presets: dict[str, Any] | None = None) -> ColumnMap:
    """Column map of what a YAML file holds; ``presets`` stand for what it leaves out, on both levels.

    Raises :class:`Refused` with every fault and its place in ``source``, such as ``columns.usb_degC.scale``.
    """
    if isinstance(data, dict):
        parts = {key: each for key, each in (presets or {}).items() if isinstance(each, dict)}
        both = {key: each | data[key] for key, each in parts.items() if isinstance(data.get(key), dict)}
        data = {**(presets or {}), **data, **both}
    return validated(ColumnMap, data, source, _target_faults(data))


def _target_faults(data: Any) -> list[Fault]:
    """What is wrong between a trace column's name and its source's unit, in a map that may be wrong otherwise."""
    faults = []
    sections = {key: data.get(key) for key in ("columns", "constants")} if isinstance(data, dict) else {}
    entries = {key: each for key, each in sections.items() if isinstance(each, dict)}
    for section, name, entry in [(key, *item) for key, each in entries.items() for item in each.items()]:
        place = f"{section}.{name}"
        text = str(name)
        if not (text.isascii() and text.isidentifier()) or split_column(text) == ("", ""):
            faults.append(Fault(place, "is no column's name", "name it <name>_<unit>, such as usb_degC"))
            continue
        if name == "time_s":
            faults.append(Fault(place, "the time is not mapped here", "describe it under 'time'"))
        if section == "constants" and name in entries.get("columns", {}):
            faults.append(Fault(place, "stands under 'columns' too", "remove one"))
        unit = entry.get("unit") if isinstance(entry, dict) else None
        target = target_unit(name)
        if isinstance(unit, str) and BASES.get(unit, target) != target:
            fitting = ", ".join(each for each, base in BASES.items() if base == target)
            hint = f"take one of {fitting}" if target else f"end its name in _{BASES[unit]}"
            faults.append(Fault(f"{place}.unit", f"{unit} does not become {target or split_column(name)[1]}", hint))
    return faults
