"""A map and a file of offsets say what they mean; a wrong one is refused with every fault and its place."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.data.importers._column_map import ColumnMap, parse_map
from ambient_trainer.data.probe_offsets import ProbeOffset, load_offsets
from ambient_trainer.data.strict_yaml import load_yaml, parse_yaml
from documents import anything
from refusals import refused, refused_places

_GOOD = "time: {column: t, unit: s}\ncolumns:\n  usb_degC: T_usb\n"


def _parsed(text):
    return parse_map(parse_yaml(text, "m.yaml"), "m.yaml")


def test_shorthand_and_numbers_are_names():
    assert _parsed(_GOOD) == _parsed(_GOOD.replace("T_usb", "{from: [T_usb]}"))
    source = _parsed(_GOOD.replace("T_usb", "{from: 101, missing: [-32768, NaN, 9.9E+37]}")).columns["usb_degC"]
    assert source.sources == ("101",)
    assert [str(float(each)) for each in source.missing] == ["-32768.0", "nan", "9.9e+37"]


# a map, and the place and a word of its one fault
WRONG = [
    ("columns: {usb_degC: T}", "time", "missing"),
    ("time: {column: t, unit: s}\ncolumns:", "columns", "no columns"),
    ("time: {column: t}\ncolumns: {a_degC: T}", "time", "neither 'unit' nor 'format'"),
    ("time: {column: [d, t], unit: s}\ncolumns: {a_degC: T}", "time", "a number in several columns"),
    ("- usb_degC", "", "a mapping"),
    (_GOOD + "colums: 1", "colums", "skip_under_header, drop_rows, bad_rows"),
    (_GOOD.replace("T_usb", "{from: T, scal: 2}"), "columns.usb_degC.scal", "combine, unit, scale"),
    (_GOOD.replace("T_usb", "{from: T, unit: mW}"), "columns.usb_degC.unit", "degC, ddegC, cdegC, mdegC, degF, K"),
    (_GOOD.replace("usb_degC", "fan_rpm").replace("T_usb", "{from: T, unit: mW}"), "columns.fan_rpm.unit", "_W"),
    (_GOOD.replace("T_usb", "{from: T, scale: 0}"), "columns.usb_degC.scale", "scale of 0"),
    (_GOOD.replace("T_usb", "{from: [A, B]}"), "columns.usb_degC", "2 columns"),
    (_GOOD.replace("T_usb", "{from: A, combine: mean}"), "columns.usb_degC", "single column"),
    (_GOOD.replace("T_usb", "on"), "columns.usb_degC.from[0]", "True"),
    (_GOOD.replace("usb_degC", "usb"), "columns.usb", "<name>_<unit>"),
    (_GOOD.replace("usb_degC", "time_s"), "columns.time_s", "'time'"),
    (_GOOD + "constants: {usb_degC: 22}", "constants.usb_degC", "'columns'"),
    (_GOOD + "constants: {a_W: 2e40}", "constants.a_W", "2e+40"),
    (_GOOD + "delimiter: '\"'", "delimiter", "whitespace"),
    (_GOOD + "header: false\nskip_under_header: 1", "", "'skip_under_header'"),
    (_GOOD + "drop_rows: {Status: [on]}", "drop_rows.Status[0]", "True"),
    (_GOOD + "notes: {start: 5}", "notes", "'start'"),
    (_GOOD + 'notes: {a: "b\\nc"}', "notes", "one line"),
    (_GOOD + "decimal: ','", "", "both delimiter and decimal"),
    (_GOOD + "encoding: cp99", "encoding", "'cp99'"),
    (_GOOD + "  usb_degC: U\n", "line 4, column 3", "'usb_degC' is duplicated"),
    ("time: [", "line 1, column 8", "not YAML"),
]


@pytest.mark.parametrize(("text", "place", "word"), WRONG)
def test_a_wrong_map_is_refused_by_place(text, place, word):
    [fault] = refused(_parsed, text).faults
    assert fault.place == place
    assert word in str(fault)


def test_every_fault_is_named_at_once():
    text = """
time: {column: t, unit: weeks}
columns:
  usb_degC: {from: A, scale: steep}
  soc_degC: {from: B, unit: furlong}
  battery_degC: {from: C, unit: mA}
  x: D
"""
    columns = [f"columns.{each}" for each in ("usb_degC.scale", "soc_degC.unit", "battery_degC.unit", "x")]
    assert refused_places(_parsed, text) == ["time.unit", *columns]


@given(st.binary(max_size=200))
def test_any_bytes_are_a_map_or_refused(tmp_path_factory, raw):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(raw)
    refused(lambda: parse_map(load_yaml(str(path)), "m"))


_entry = st.dictionaries(
    st.sampled_from(["from", "unit", "scale", "offset", "missing", "combine"]), anything() | st.just("mW")
)


@settings(max_examples=40)
@given(st.dictionaries(st.sampled_from([*ColumnMap.model_fields]), anything()), _entry)
def test_any_structure_is_a_map_or_refused(data, entry):
    for columns in (data.get("columns"), {"usb_degC": entry}):
        with contextlib.suppress(Refused):
            parse_map(data | {"columns": columns}, "m")


FILE = """\
format: probe-offsets
version: 1
created: 2026-05-01T10:00:00+00:00
reference: GMH thermometer
probes:
  air1:
    points:
    - {reading_degC: 0.1, offset_K: -0.1, standard_error_K: 0.002}
    - {reading_degC: 39.7, offset_K: 0.3, standard_error_K: 0.003}
  air2:
    points: [{reading_degC: 20.0, offset_K: 0.05, standard_error_K: 0.001}]
"""


@given(
    points=st.dictionaries(st.integers(-50, 150), st.floats(-2.0, 2.0), min_size=1, max_size=6),
    reading_degC=st.floats(-60.0, 200.0),
)
def test_between_the_points_it_is_interpolated_and_beyond_them_the_nearest_holds(points, reading_degC):
    data = [{"reading_degC": at, "offset_K": points[at], "standard_error_K": 0.0} for at in sorted(points)]
    offset_K = ProbeOffset.model_validate({"points": data}).at(reading_degC)
    below = [at for at in points if at <= reading_degC]
    above = [at for at in points if at >= reading_degC]
    near = [points[at] for at in ([max(below)] if below else []) + ([min(above)] if above else [])]
    assert min(near) - 1e-9 <= offset_K <= max(near) + 1e-9
    if below and above and max(below) < min(above):
        share = (reading_degC - max(below)) / (min(above) - max(below))
        assert offset_K == pytest.approx((1 - share) * near[0] + share * near[1], abs=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "parts"),
    [
        ("version: 1", "version: 2", ["version", "2: input should be 1"]),
        ("reading_degC: 39.7", "reading_degC: 0.1", ["probes.air1.points", "increase"]),
        ("offset_K: 0.05", "offset_K: .nan", ["probes.air2.points[0].offset_K", "nan"]),
        ("standard_error_K: 0.001", "sigma: 1", ["probes.air2.points[0].sigma", "unknown key"]),
        (FILE, "", ["None"]),
        ("2026-05-01T10:00:00+00:00", "yesterday", ["created", "'yesterday'"]),
    ],
)
def test_a_file_that_is_none_is_refused(write, before, after, parts):
    path = write("offsets.yaml", FILE.replace(before, after))
    said = str(refused(load_offsets, path))
    assert all(part in said for part in [path, *parts])
