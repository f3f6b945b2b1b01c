"""The multiplexer's export comes in with its own units, sentinel and clock, with and without a map."""

import contextlib
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.data.importers.benchlink import import_file
from refusals import refused

_TIMES = ["02/02/2000 23:59:55:402", "02/03/2000 00:00:05:400"]


def _export(*channels, rows=(("+1.0E+01",), ("+2.0E+01",))):
    lines = [",".join(["Sweep #", "Time", *channels])]
    lines += [
        ",".join([str(k + 1), _TIMES[k], *(row * len(channels) if len(row) == 1 else row)])
        for k, row in enumerate(rows)
    ]
    return "\r\n".join(lines) + "\r\n"


def _message(path, map_path=None):
    return str(refused(import_file, path, map_path))


def test_every_channel_comes_in_without_a_map(write):
    trace = import_file(write("a.csv", _export("Chan 101 (C)", "Chan 102 (F)", "Chan 203 (K)"))).trace
    assert trace.time_s.tolist() == [0.0, 9.998]
    assert {name: values.tolist() for name, values in trace.columns.items()} == {
        "ch101_degC": [10.0, 20.0],
        "ch102_degC": [pytest.approx(-12.222222222), pytest.approx(-6.666666667)],
        "ch203_degC": [-263.15, -253.15],
    }
    assert trace.notes == {"source": "a.csv", "start": "2000-02-02T23:59:55.402000"}


def test_an_open_thermocouple_is_missing(write):
    path = write("a.csv", _export("Chan 101 (C)", "Chan 102 (F)", rows=(("+9.90000000E+37",) * 2, ("-9.9E+37", "50"))))
    columns = import_file(path).trace.columns
    assert np.isnan(columns["ch101_degC"]).all()
    assert columns["ch102_degC"].tolist() == pytest.approx([np.nan, 10.0], nan_ok=True)


def test_lines_above_the_header_are_skipped_and_counted_and_without_one_it_is_another_file(write):
    path = write("a.csv", "Acquisition 7\r\n\r\n" + _export("Chan 101 (C)", rows=(("1",), ("x",))))
    assert f"{path}: line 5, column Chan 101 (C): 'x'" in _message(path)
    path = write("a.csv", "t,a\n0,1\n")
    assert f"{path}: no line starts with 'Sweep #,'" in _message(path)


def test_a_voltage_is_refused_unless_left_out_or_explained(write):
    path = write("a.csv", _export("Chan 101 (C)", "Chan 102 (VDC)"))
    assert f"{path}: columns.ch102_degC: the channel is in VDC" in _message(path)
    assert list(import_file(path, write("out.yaml", "columns: {a_degC: 101}")).trace.columns) == ["a_degC"]
    shunt = write("shunt.yaml", "columns: {battery_current_A: {from: 102, scale: 100}}")
    assert import_file(path, shunt).trace.columns["battery_current_A"].tolist() == [1000.0, 2000.0]
    volts = write("volts.yaml", "columns: {battery_V: {from: 102, unit: mV}}")
    assert import_file(path, volts).trace.columns["battery_V"].tolist() == [0.01, 0.02]


@pytest.mark.parametrize(
    ("columns", "fact"),
    [
        ("a_W: 101", "columns.a_W: the channel is in C"),
        ("a_degC: {from: [101, 102], combine: mean}", "columns.a_degC: combines channels in C and F"),
        ("a_degC: 199", "columns.a_degC.from: no column '199'"),
    ],
)
def test_a_map_that_does_not_fit_is_refused(write, columns, fact):
    path, mapped = write("a.csv", _export("Chan 101 (C)", "Chan 102 (F)")), write("m.yaml", f"columns: {{{columns}}}")
    assert f"{mapped}: {fact}" in _message(path, mapped)


def test_a_measured_export_comes_in(beside, described):
    path = beside("measured/thermal-shock-chamber/dat00002.csv")
    trace = import_file(str(path), str(described / "thermal-shock-chamber-thesis-names.map.yaml")).trace
    raw = np.genfromtxt(path, delimiter=",", skip_header=1)[:, 2:]
    raw[np.abs(raw) > 1e37] = np.nan
    channels = {"flash": 102, "battery": 112, "usb": 105, "display": 110, "soc": 108, "ambient": 101}
    assert list(trace.columns) == [f"{name}_degC" for name in channels]
    for name, channel in channels.items():
        np.testing.assert_array_equal(trace.columns[f"{name}_degC"], raw[:, channel - 101])
    assert np.flatnonzero(np.isnan(trace.reference)).tolist() == [5165]
    lines = path.read_text().splitlines()
    clock = [datetime.strptime(lines[k].split(",")[1] + "000", "%m/%d/%Y %H:%M:%S:%f") for k in (1, -1)]
    assert trace.time_s[-1] == pytest.approx((clock[1] - clock[0]).total_seconds(), abs=1e-6)


@given(st.binary(max_size=200))
def test_any_bytes_under_the_header_are_read_or_refused(tmp_path_factory, raw):
    path = tmp_path_factory.getbasetemp() / "any-export.csv"
    path.write_bytes(_export("Chan 101 (C)").encode() + raw)
    with contextlib.suppress(Refused):
        assert len(import_file(str(path)).trace.time_s) >= 2
