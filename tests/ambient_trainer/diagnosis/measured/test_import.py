"""The measured sets come in whole, through a map each: every value is what the file says, read another way."""

import csv
import itertools
from datetime import datetime

import numpy as np
import pytest

from ambient_trainer.data.trace import load_trace
from ambient_trainer.evaluation.black_box import black_box_rmse_degC


@pytest.mark.parametrize("house", ["O5", "N2"])
def test_a_modelica_table_of_a_house(measured, measured_folder, house):
    trace = load_trace(measured(house))
    raw = np.loadtxt(measured_folder / f"twinhouse/validationdata{house}Exp1.txt", skiprows=2).T
    assert raw.shape == (51, 5905)
    np.testing.assert_array_equal(trace.time_s, raw[0] - raw[0, 0])
    np.testing.assert_allclose(trace.columns["living_degC"], raw[4:7].mean(axis=0), atol=1e-9)
    for name, number in {
        "heater_living_power_W": 20,
        "ambient_degC": 36,
        "irradiance_W_m2": 37,
        "irradiance_south_W_m2": 41,
        "wind_m_s": 45,
        "cellar_degC": 4,
    }.items():
        np.testing.assert_array_equal(trace.columns[name], raw[number - 1])


@pytest.mark.parametrize("name", ["naked", "closed", "fan_in", "fan_out"])
def test_a_board_in_a_room_that_nobody_logged(measured, measured_folder, name):
    trace = load_trace(measured(name))
    with open(measured_folder / "rpi3-case-fan" / trace.notes["source"], newline="") as stream:
        rows = list(csv.DictReader(stream))
    start = datetime.fromisoformat(rows[0]["datetime"])
    seconds = [(datetime.fromisoformat(row["datetime"]) - start).total_seconds() for row in rows]
    np.testing.assert_allclose(trace.time_s, seconds, atol=1e-6)
    np.testing.assert_array_equal(trace.columns["soc_degC"], [float(row["temp"]) for row in rows])
    np.testing.assert_allclose(trace.columns["cpu_load_frac"], [float(row["usage"]) / 100 for row in rows], atol=1e-9)
    assert set(trace.reference.tolist()) == {22.0}
    assert trace.notes["assumed"] == "ambient_degC = 22, powered_on = 1 (not logged)"


@pytest.mark.parametrize(
    ("name", "rows", "ambient_degC"), [("cell_0", 1613, 0.1), ("cell_10", 1640, 9.9), ("cell_25", 1399, 24.6)]
)
def test_a_cell_in_a_chamber(measured, measured_folder, name, rows, ambient_degC):
    trace = load_trace(measured(name))
    with open(measured_folder / "lg-m50-cell" / trace.notes["source"], newline="") as stream:
        raw = list(csv.reader(stream))[15:]
    names, logged = raw[0], [row for row in raw[2:] if row[1] not in ("RANGE", "STO")]
    latest, kept = -1.0, []
    for row in logged:
        if float(row[3]) > latest:
            kept.append(row)
            latest = float(row[3])
    assert len(trace.time_s) == len(kept) == rows
    for column, name_there in {"cell_degC": "LogTemp001", "current_A": "Current", "voltage_V": "Voltage"}.items():
        index = names.index(name_there)
        np.testing.assert_array_equal(trace.columns[column], [float(row[index]) for row in kept])
    assert set(trace.reference.tolist()) == {ambient_degC}
    assert trace.notes["assumed"] == f"ambient_degC = {ambient_degC} (not logged)"


def test_a_cell_beside_a_thermocouple_in_the_air(measured):
    trace = load_trace(measured("cell_2C"))
    assert len(trace.time_s) == 13357
    assert "assumed" not in trace.notes
    at_rest = trace.time_s < 7000
    assert trace.columns["cell_degC"][at_rest].mean() == pytest.approx(trace.reference[at_rest].mean(), abs=0.01)
    assert trace.columns["current_A"].min() == pytest.approx(-10, abs=0.01)


@pytest.mark.parametrize(("name", "later_s", "by_hand_degC"), [("30q", 29_527, 0.18), ("li18650", 518_400, 0.24)])
def test_a_black_box_explains_what_a_circuit_does(measured, name, later_s, by_hand_degC):
    """``by_hand_degC`` is what the best circuit leaves of the first 60 %, which it was fitted to."""
    trace = load_trace(measured(name)).cut(None, later_s)
    every = slice(None, None, max(1, len(trace.time_s) // 1500))
    inputs = {each: row[every] for each, row in trace.columns.items() if each != "cell_degC"}
    samples = len(trace.time_s[every])
    edges = np.linspace(0, samples, 6).astype(int)
    blocks = [slice(start, stop) for start, stop in itertools.pairwise(edges)]
    floor = black_box_rmse_degC(trace.time_s[every], inputs, trace.columns["cell_degC"][every][None], blocks)
    assert 0.02 < floor < 1.1 * by_hand_degC
