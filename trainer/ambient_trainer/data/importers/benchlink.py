"""A multiplexer's export: ``Sweep #,Time,Chan 101 (C),...``, its header with units; +-9.9E+37 is an open thermocouple.

A map may choose, rename and combine the channels; it names one by its number (``101``) or by its whole header.
Without a map every channel comes in as ``ch101_degC``.
"""

import csv
import io
import re
from typing import NamedTuple

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.data.importers._column_map import ColumnMap, ColumnSource, parse_map
from ambient_trainer.data.importers._table import Imported, decoded, import_table
from ambient_trainer.data.strict_yaml import load_yaml
from ambient_trainer.data.units import target_unit

_TIME = {"column": "Time", "format": "%m/%d/%Y %H:%M:%S:%f"}
_OPEN_THERMOCOUPLE = ("9.9E+37", "-9.9E+37")
_HEADER = re.compile(r'"?Sweep #"?(?P<delimiter>[,;\t])')
_CHANNEL = re.compile(r"Chan (?P<number>\d+)\b.*\((?P<unit>[^()]*)\)")
_UNITS = {"C": "degC", "F": "degF", "K": "K"}


class _Header(NamedTuple):
    rows_above: int
    delimiter: str
    channels: dict[str, str]
    """The column of each channel by its number."""
    units: dict[str, str]
    """The unit of each channel by its column."""


HELP = "the export of a 34970A multiplexer's logging software"


def import_file(path: str, map_path: str | None = None) -> Imported:
    """Trace in a multiplexer's export; without a map, every channel becomes a column. Raises :class:`Refused`."""
    data = load_yaml(map_path) if map_path is not None else {}
    encoding = data.get("encoding") if isinstance(data, dict) else None
    header = _find_header(path, encoding if isinstance(encoding, str) else None)
    if map_path is None:
        data = {"columns": {f"ch{number}_degC": column for number, column in header.channels.items()}}
    source = map_path or path
    presets = {"time": _TIME, "skip_rows": header.rows_above, "delimiter": header.delimiter}
    return import_table(path, _with_channels(parse_map(data, source, presets), header, source), source)


def _find_header(path: str, encoding: str | None) -> _Header:
    for index, line in enumerate(io.StringIO(decoded(path, encoding), newline="")):
        if match := _HEADER.match(line):
            names = next(csv.reader([line], delimiter=match["delimiter"]))
            found = [each for name in names if (each := _CHANNEL.fullmatch(name.strip()))]
            channels, units = {each["number"]: each[0] for each in found}, {each[0]: each["unit"] for each in found}
            return _Header(index, match["delimiter"], channels, units)
    hint = "is it the logging software's export? Take --format csv and a map for other files"
    raise refuse(path, "", "no line starts with 'Sweep #,'", hint)


def _with_channels(column_map: ColumnMap, header: _Header, source: str) -> ColumnMap:
    """The map with channel numbers spelt out as the file does, and each channel's unit from its header."""
    faults: list[Fault] = []
    columns = {}
    for name, column in column_map.columns.items():
        sources = tuple(header.channels.get(each, each) for each in column.sources)
        units = {header.units[each] for each in sources if each in header.units}
        if fault := _unit_fault(name, column, units):
            faults.append(fault)
        unit = column.unit or _UNITS.get(next(iter(units), ""))
        columns[name] = column.model_copy(update={"sources": sources, "unit": unit})
    if faults:
        raise Refused(source, faults)
    missing = (*column_map.missing, *_OPEN_THERMOCOUPLE)
    return column_map.model_copy(update={"columns": columns, "missing": missing})


def _unit_fault(name: str, column: ColumnSource, units: set[str]) -> Fault | None:
    place, unit = f"columns.{name}", " and ".join(sorted(units))
    if column.unit is not None or not units:
        return None
    if len(units) > 1:
        return Fault(place, f"combines channels in {unit}", "combine channels of one unit")
    if unit in _UNITS and target_unit(name) != "degC":
        return Fault(place, f"the channel is in {unit}", "end the column's name in _degC")
    if unit not in _UNITS and "scale" not in column.model_fields_set:
        hint = "give its 'unit' or 'scale' in a map, or choose other channels in it"
        return Fault(place, f"the channel is in {unit}, no temperature", hint)
    return None
