"""Foreign CSV files become traces: units, dates, German numbers, sentinels, and one clear message for a wrong file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.data.importers._column_map import parse_map
from ambient_trainer.data.importers._table import import_table
from ambient_trainer.data.importers.csv import import_file
from ambient_trainer.data.trace import load_trace, save_trace
from refusals import refused

_TIME = {"column": "t", "unit": "s"}


def _imported(path, columns, time=_TIME, **layout):
    return import_table(path, parse_map({"time": time, "columns": columns, **layout}, "m.yaml"), "m.yaml")


def _columns(path, columns, **layout):
    return {name: values.tolist() for name, values in _imported(path, columns, **layout).trace.columns.items()}


@pytest.mark.parametrize(
    ("name", "unit", "text", "value"),
    [
        ("a_degC", "mdegC", "30241", 30.241),
        ("a_degC", "degF", "212", 100.0),
        ("a_degC", "K", "300.15", 27.0),
        ("a_W", "mW", "1234.5", 1.2345),
        ("a_frac", "percent", "45.2", 0.452),
        ("wind_m_s", "km_h", "36", 10.0),
        ("irradiance_W_m2", "kW_m2", "0.8", 800.0),
        ("clock_Hz", "MHz", "1804.8", 1804800000.0),
    ],
)
def test_units_become_the_traces(write, name, unit, text, value):
    assert _columns(write("a.csv", f"t,a\n0,{text}\n"), {name: {"from": "a", "unit": unit}}) == {name: [value]}


def test_values_are_scaled_averaged_over_those_that_read_and_missing_as_told(write):
    path = write("a.csv", "t,a\n0,1000\n")
    assert _columns(path, {"a_degC": {"from": "a", "unit": "mdegC", "scale": 2, "offset": -0.5}}) == {"a_degC": [1.5]}
    path = write("a.csv", "t,a,b,c\n0,1,2,6\n1,1,,6\n2,,,\n")
    mean = _columns(path, {"a_degC": {"from": ["a", "b", "c"], "combine": "mean"}})["a_degC"]
    median = _columns(path, {"a_degC": {"from": ["a", "b", "c"], "combine": "median"}})["a_degC"]
    assert mean == pytest.approx([3.0, 3.5, np.nan], nan_ok=True)
    assert median == pytest.approx([2.0, 3.5, np.nan], nan_ok=True)
    path = write("a.csv", "t,a,b\n0,-,NaN\n1,+9.90000000E+37,\n2,-32768.0,nan\n3,5,-1\n")
    columns = _columns(
        path, {"a_degC": {"from": "a", "missing": ["-", "9.9E+37", -32768]}, "b_degC": "b"}, missing=["-1"]
    )
    assert columns == {
        "a_degC": pytest.approx([np.nan] * 3 + [5.0], nan_ok=True),
        "b_degC": pytest.approx([np.nan] * 4, nan_ok=True),
    }


@pytest.mark.parametrize(
    ("time", "texts", "seconds", "start"),
    [
        ({"unit": "ms"}, ["1764155611546", "1764155612575"], [0, 1.029], "1764155611.546 s"),
        ({"unit": "h"}, ["1", "1.25"], [0, 900], "3600 s"),
        ({"format": "%H:%M"}, ["08:00", "08:10"], [0, 600], None),
        ({"format": "%d.%m.%Y"}, ["28.02.2024", "01.03.2024"], [0, 172800], "2024-02-28T00:00:00"),
        ({"column": ["t", "a"], "format": "%d.%m.%Y %H"}, ["28.02.2024"], [0], "2024-02-28T01:00:00"),
        ({"format": "iso"}, ["2020-07-29 06:12:38", "2020-07-29T06:12:39.622"], [0, 1.622], "2020-07-29T06:12:38"),
        ({"format": "iso"}, ["2020-07-29T06:12:38Z", "2020-07-29T08:12:39+02:00"], [0, 1], "2020-07-29T06:12:38+00:00"),
    ],
)
def test_time_counts_from_the_first_row(write, time, texts, seconds, start):
    path = write("a.csv", "t,a\n" + "".join(f"{text},1\n" for text in texts))
    trace = _imported(path, {"a_degC": "a"}, time={"column": "t", **time}).trace
    assert trace.time_s.tolist() == seconds
    assert trace.notes.get("start") == start  # as `join` takes it


def test_a_german_export_is_read(tmp_path):
    path = tmp_path / "messung.csv"
    head = '# Prüfling 7\nLogger;V1\nZeit;"Fühler; 1 (°C)";Bemerkung\n'
    rows = head + "01.02.2024 10:00:00;-12,5;\n# Pause\n01.02.2024 10:00:10;1,25;gut\n"
    path.write_bytes(rows.replace("\n", "\r\n").encode("cp1252"))
    trace = _imported(
        str(path),
        {"ambient_degC": "Fühler; 1 (°C)"},
        time={"column": "Zeit", "format": "%d.%m.%Y %H:%M:%S"},
        delimiter=";", decimal=",", encoding="cp1252", comment="#", skip_rows=2,
    ).trace  # fmt: skip
    assert trace.time_s.tolist() == [0, 10]
    assert trace.reference.tolist() == [-12.5, 1.25]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_tells_the_encoding(tmp_path, encoding):
    (tmp_path / "a.csv").write_bytes("t,a\n0,1\n".encode(encoding))
    assert _columns(str(tmp_path / "a.csv"), {"a_degC": "a"}) == {"a_degC": [1.0]}


def test_rows_that_cannot_be_read_are_dropped_where_the_map_says_so(write):
    rows = ["nan,1", "0,1", "later,2", "1,warm", "2,inf", "3", "4,2,?", "5,", "4,7", "-1e308,1", "6,1e300", "7,2"]
    imported = _imported(
        write("a.csv", "\n".join(["t,a", *rows]) + "\n"), {"a_degC": {"from": "a", "unit": "mdegC", "scale": 1000}},
        time={**_TIME, "not_increasing": "drop"}, bad_rows="drop",
    )  # fmt: skip
    assert imported.trace.time_s.tolist() == [0, 5, 7]
    assert imported.trace.columns["a_degC"].tolist() == pytest.approx([1, np.nan, 2], nan_ok=True)
    assert imported.trace.notes["start"] == "0 s"
    assert imported.dropped == {"they cannot be read": 8, "their time did not increase": 1}
    assert imported.trace.notes["dropped_rows"] == "9"


def test_what_nobody_logged_comes_in_as_assumed(write, tmp_path):
    path = write("a.csv", "t,a\n0,1\n1,2\n")
    trace = _imported(
        path, {"a_degC": "a"}, constants={"ambient_degC": 21.5, "idle_W": 2}, notes={"room": "by the window"}
    ).trace
    assert trace.reference.tolist() == [21.5, 21.5]
    assert trace.columns["idle_W"].tolist() == [2, 2]
    out = str(tmp_path / "o.csv")
    save_trace(out, trace)
    assert load_trace(out).notes == {
        "source": "a.csv",
        "start": "0 s",
        "assumed": "ambient_degC = 21.5, idle_W = 2 (not logged)",
        "room": "by the window",
    }


# a table, its layout, and the place and a word of what is wrong
WRONG = [
    ("", {}, "", "no header line"),
    ("t,a\n", {}, "", "no rows"),
    ("", {"header": False}, "", "no row"),
    ("0,1\n1,2\n", {"header": False, "time": {"column": 1, "unit": "s"}}, "columns.a_degC.from", "line 1 has 1, 2"),
    ("t,a\n0,1\n", {"drop_rows": {"s": ["x"]}}, "drop_rows.s", "line 1 has t, a"),
    ("t,a\n0,1\n1,1\n", {"drop_rows": {"a": [1]}}, "", "2 dropped since the map's 'drop_rows'"),
    ("t,a\nx,1\n1,y\nnan,1\n", {"bad_rows": "drop"}, "", "3 dropped since they cannot be read"),
    ("t,b\n0,1\n", {}, "columns.a_degC.from", "line 1 has t, b"),
    ("t,a,a\n0,1,2\n", {}, "columns.a_degC.from", "'a' is duplicated"),
    ("t,a\n0,1\n1\n", {}, "line 3", "1 cells where the header has 2"),
    ("t,a\n0,1\n\n1,warm\n", {}, "line 4, column a", "'warm'"),
    ('t,a\n0,"1,5"\n', {}, "line 2, column a", "decimal comma"),
    ("t;a\n0;1.500\n", {"delimiter": ";", "decimal": ","}, "line 2, column a", "'1.500'"),
    ("t,a\n0,inf\n", {}, "line 2, column a", "finite"),
    ("t,a\n0,1\nnan,2\n", {}, "line 3, column t", "'nan'"),
    ("t,a\n0,1\n,2\n", {}, "line 3, column t", "''"),
    ("t,a\n0,1\n2,1\n2,1\n1,1\n", {}, "line 4, column t", "leaves out 2 of 4 rows"),
    ("t,a\n5,1\n9,x\n3,2\n", {"bad_rows": "drop"}, "line 4, column t", "3 does not come after 5"),
    ("t,a\n0,1\n", {"time": {"column": "t", "format": "%H:%M"}}, "line 2, column t", "'%H:%M'"),
    ("t,a\n9,1\n8,1\n", {"time": {"column": "t", "format": "%H"}}, "line 3, column t", "a column of the date"),
    ("t;a\n0;1\n", {"time": {"column": "t;a", "unit": "s"}}, "columns.a_degC.from", 'delimiter: ";"'),
    ("PK\x03\x04", {}, "", "spreadsheet"),
    ("t,a\n0,1\n1,1e300\n", {"columns": {"a_degC": {"from": "a", "scale": 1e10}}}, "line 3, column a", "'1e300'"),
]


def _faults(path, columns=None, **layout):
    return refused(_imported, path, columns or {"a_degC": "a"}, **layout).faults


@pytest.mark.parametrize(("text", "layout", "place", "word"), WRONG)
def test_a_wrong_file_is_refused_by_line_and_column(write, text, layout, place, word):
    [fault] = _faults(write("a.csv", text), **layout)
    assert fault.place == place
    assert word in str(fault)


def test_each_column_tells_its_first_fault_and_another_encoding_its_line(write, tmp_path):
    path = write("a.csv", "t,a,b\n0,1,x\n1,y,2\n2,z,3\n")
    faults = _faults(path, {"a_degC": "a", "b_degC": "b"})
    assert [each.place for each in faults] == ["line 3, column a", "line 2, column b"]
    path = tmp_path / "a.csv"
    path.write_bytes(b"t,a\n0,1\n1,\xb0\n")
    [fault] = _faults(str(path))
    assert fault.place == "line 3"
    assert "utf-8" in fault.problem


def test_a_phones_zones_come_in(beside, described, tmp_path):
    path = beside("measured/s25plus-zones/s25_zones_tidy.csv")
    imported = import_file(str(path), str(described / "s25plus-zones.map.yaml"))
    raw = np.genfromtxt(path, delimiter=",", skip_header=1)
    clock = raw[:, 0]
    kept = np.array([k == 0 or clock[k] > clock[:k].max() for k in range(len(clock)) if k < 3000])
    trace = imported.trace
    assert len(clock) - len(trace.time_s) == imported.dropped_rows == 80
    assert (np.diff(trace.time_s) > 0).all()
    head = int(kept.sum())
    assert trace.time_s[:head] == pytest.approx(clock[:3000][kept] - clock[0], abs=1e-6)
    names = ["cpu_big_degC", "cpu_little_degC", "gpu_degC", "battery_degC", "modem_degC", "chassis_degC", "skin_degC"]
    for index, name in enumerate(names):
        np.testing.assert_array_equal(trace.columns[name][:head], raw[:3000][kept][:, index + 1])
    assert 16 <= np.isnan(trace.columns["cpu_big_degC"]).sum() <= 36


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=5, unique=True).map(sorted),
    st.data(),
    st.sampled_from([",", ";", "\t", "|", "whitespace"]),
    st.booleans(),
    st.integers(0, 3),
    st.integers(0, 2),
)
def test_any_layout_of_the_same_numbers_is_the_same_trace(
    tmp_path_factory, times, data, delimiter, header, above, below
):
    values = data.draw(st.lists(st.floats(-1e6, 1e6), min_size=len(times), max_size=len(times)))
    path = tmp_path_factory.getbasetemp() / "layout.txt"
    by = data.draw(st.text(" \t", min_size=1, max_size=3)) if delimiter == "whitespace" else delimiter
    lines = [f"about it {line}" for line in range(above)]
    lines += [f"t{by}s{by}a", *[f"s{by}x{by}K"] * below] if header else []
    for time_s, value in zip(times, values):
        lines += [f"{time_s!r}{by}ok{by}{value!r}", f"0{by}skipped{by}7"]
    path.write_text("\n".join(lines), newline="")
    t, s, a = ("t", "s", "a") if header else ("1", "2", "3")
    trace = _imported(
        str(path), {"a_K": a}, time={"column": t, "unit": "s", "not_increasing": "drop"}, delimiter=delimiter,
        header=header, skip_rows=above, skip_under_header=below if header else 0, drop_rows={s: ["skipped"]},
    ).trace  # fmt: skip
    seconds = np.round(np.array(times) - times[0], 6)
    kept = [row for row in range(len(seconds)) if row == 0 or seconds[row] > seconds[:row].max()]
    assert trace.time_s.tolist() == seconds[kept].tolist()
    assert trace.columns["a_K"].tolist() == [values[row] for row in kept]


_cell = st.text(st.sampled_from('0123456789.,-+eE"; nNaA\t#'), max_size=6)


@given(
    st.lists(st.lists(_cell, min_size=1, max_size=4), max_size=6),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.just(b"") | st.binary(max_size=200),
)
def test_any_table_becomes_a_trace_that_reads_back_or_is_refused(tmp_path_factory, rows, newline, raw):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(b"t,a\n" + newline.join(",".join(row) for row in rows).encode() + raw)
    for layout in ({}, {"bad_rows": "drop"}, {"delimiter": "whitespace"}):
        more = {"missing": ["#"], "constants": {"b_degC": 1}, **layout}
        try:
            trace = _imported(str(path), {"a_degC": {"from": "a", "unit": "degF"}}, **more).trace
        except Refused:
            continue
        out = str(path.with_suffix(".out"))
        save_trace(out, trace)
        np.testing.assert_array_equal(load_trace(out).time_s, trace.time_s)
        np.testing.assert_array_equal(load_trace(out).columns["a_degC"], trace.columns["a_degC"])
