"""The extended circuit simulates what the model with its effects does; it fits, and a device runs it."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ambient_trainer.circuits.circuit import Source
from ambient_trainer.circuits.schema import load_circuit, parse_circuit
from ambient_trainer.circuits.write import save_circuit, write_circuit
from ambient_trainer.cli.commands.evaluate import command as evaluate
from ambient_trainer.cli.commands.fit import command as fit
from ambient_trainer.data.trace import Trace, save_trace
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.extended_circuit import extended_circuit
from ambient_trainer.diagnosis.fit import TrainingSet, fit_model
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.model import Effect, Model, view
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.diagnosis.training import records_of, residual_noise
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.circuit import CircuitEstimator
from ambient_trainer.simulator.hidden import Hidden
from ambient_trainer.simulator.simulate import simulate_many
from ambientd.__main__ import main as ambientd

PERIOD_S = 5.0
TIME_S = PERIOD_S * np.arange(1200)
ON = (TIME_S % 1800.0 > 900.0).astype(float)

RISE = (Path(__file__).parents[2] / "data" / "circuits" / "three_beside_one.yaml").read_text()
SOURCE, PATH = Cause("heat_source", "shell", "charging_on"), Cause("path", "board-cell")
ALL, ONE = Cause("ambient_coupling"), Cause("ambient_coupling", "shell")
MASS = Cause("thermal_mass", "cell")


@pytest.fixture
def circuit():
    return parse_circuit(RISE, "rise.yaml")


@pytest.fixture
def fixed():
    """The same with known capacitances: watts are watts."""
    return parse_circuit(RISE.replace("initial: 12}", "initial: 12, free: false}"), "fixed.yaml")


def trace_of(circuit, sensors=None):
    random = np.random.default_rng(4)
    columns = dict(
        zip(("board_degC", "shell_degC", "cell_degC"), 30.0 + np.sin(TIME_S / 200.0 + np.arange(3)[:, None]))
    )
    if sensors is not None:
        columns = dict(zip(columns, sensors))
    return Trace(
        "made.csv",
        TIME_S,
        {
            **columns,
            "chip_degC": 45.0 + 8.0 * np.sin(TIME_S / 300.0),
            "ambient_degC": 20.0 + 4.0 * np.sin(TIME_S / 1100.0),
            "charging_on": ON,
            "battery_current_A": np.round(random.uniform(0.0, 2.0, 40).repeat(30), 2),
        },
    )


def record_of(circuit, sensors=None):
    (record,) = records_of(forward(circuit), trace_of(circuit, sensors), PERIOD_S)
    return record


def model_of(circuit, *effects, moved=None):
    """The model with effects of (cause, coefficients), at ``moved`` values."""
    read = forward(circuit)
    values = {each.name: each.initial for each in read.parameters}
    plant = Plant.of(read, {**values, **(moved or {})}, PERIOD_S)
    model = Model(plant)
    candidates = list(all_candidates(setting_of(model, [view(model, record_of(circuit))])))
    for cause, *coefficients in effects:
        found = next(each for each in candidates if each.cause == cause and len(each.fixed) == len(coefficients))
        size = len(coefficients)
        model = model.with_effect(Effect(found, None, None, np.array(coefficients), np.zeros((size, size))))
    return model


def simulated(circuit, sensors):
    """What the circuit at its initial values says of the record with these sensors, (s, N)."""
    read = forward(circuit)
    plant = Plant.of(read, {each.name: each.initial for each in read.parameters}, PERIOD_S)
    return view(Model(plant), record_of(circuit, sensors)).simulated_degC


@pytest.mark.parametrize(
    ("effects", "form"),
    [
        ([(SOURCE, 0.8)], "rise"),
        ([(PATH, 0.12)], "rise"),
        ([(ALL, 0.5)], "rise"),
        ([(ONE, -0.4)], "rise"),
        ([(MASS, 0.2)], "temperature"),
        ([(SOURCE, 0.8), (PATH, 0.12), (ONE, 0.7)], "rise"),
        ([(ALL, 0.3), (MASS, 0.2), (SOURCE, -0.5)], "temperature"),
    ],
    ids=lambda value: value if isinstance(value, str) else ", ".join(str(each[0]) for each in value),
)
@pytest.mark.parametrize("scale", [1.0, 2e4])
def test_it_simulates_what_the_model_does(circuit, effects, form, scale):
    watts = [
        (cause, *(c * (1.0 if cause.name == "ambient_coupling" else scale) for c in own)) for cause, *own in effects
    ]
    moved = {"C_board": 10.0 * scale, "C_shell": 33.0 * scale, "C_cell": 20.0 * scale}
    moved |= {"R_chip_board": 5 / scale, "R_inner": 6 / scale, "R_outer": 15 / scale, "R_cell": 10 / scale}
    model = model_of(circuit, *watts, moved=moved)
    expected = view(model, record_of(circuit)).simulated_degC
    extension = extended_circuit(circuit, model)
    assert extension.circuit.form == form
    assert len(extension.left_out) == (form == "temperature")
    settled = TIME_S > 3000.0  # where it began is fitted anew: it needs a while to be forgotten
    found = simulated(extension.circuit, view(model, record_of(circuit, expected)).simulated_degC)
    assert np.abs(found - expected)[:, settled].max() < 0.02
    assert np.abs(simulated(circuit, expected) - expected)[:, settled].max() > 0.1
    # nothing tells how much heat there is: as much as the user's own values have
    size = np.prod(
        [each.initial for each in extension.circuit.parameters if each.name in moved and each.name[0] == "C"]
    )
    assert size == pytest.approx(12 * 30 * 25, rel=1e-9)


def test_values_that_are_known_keep_their_scale(fixed):
    model = model_of(fixed, (SOURCE, 0.8), moved={"C_shell": 60.0})
    found = {each.name: each for each in extended_circuit(fixed, model).circuit.parameters}
    assert (found["C_board"].initial, found["C_shell"].initial) == (12.0, 60.0)
    share = found["k_shell_charging_on"]
    assert (share.initial, share.unit, share.free) == (0.8, "W", True)


def test_a_resistance_given_as_a_number_stays_one():
    text = RISE.replace("resistance: R_cell", "resistance: 9").replace("  R_cell: {unit: K/W, initial: 9}\n", "")
    circuit = parse_circuit(text, "number.yaml")
    extended = extended_circuit(circuit, model_of(circuit, (Cause("ambient_coupling", "cell"), 0.5))).circuit
    assert "- {between: [cell, ambient], resistance: 6.0}" in write_circuit(extended).splitlines()


def test_the_form_and_the_estimate_stay_where_they_can(circuit):
    extended = extended_circuit(circuit, model_of(circuit, (SOURCE, 0.8))).circuit
    assert extended.outputs == circuit.outputs
    assert extended.sources == (Source("shell", "charging_on", "k_shell_charging_on"),)
    assert extended.name == "rise_extended"
    assert extended.about == "Three nodes beside a hot one; with heat_source at shell by charging_on"
    assert parse_circuit(write_circuit(extended), "again") == extended


def test_a_body_without_a_sensor_costs_the_estimate(circuit):
    extension = extended_circuit(circuit, model_of(circuit, (MASS, 0.2)))
    assert [output.name for output in extension.circuit.outputs] == ["board", "shell", "cell"]
    (left_out,) = extension.left_out
    assert left_out.startswith("The estimate of the ambient")


def test_it_can_be_extended_again(circuit):
    once = extended_circuit(circuit, model_of(circuit, (SOURCE, 0.8))).circuit
    twice = extended_circuit(once, model_of(once, (SOURCE, 0.3), (Cause("heat_source", "cell", "charging_on"), 0.1)))
    assert twice.circuit.name == "rise_extended"
    assert [(each.into, each.share) for each in twice.circuit.sources] == [
        ("shell", "k_shell_charging_on"),
        ("cell", "k_cell_charging_on"),
    ]
    share = next(each for each in twice.circuit.parameters if each.name == "k_shell_charging_on")
    assert share.initial == pytest.approx(1.1)


@pytest.mark.parametrize(
    ("cause", "values", "reason"),
    [
        (Cause("heat_source", "cell", "battery_current_A"), (0.1, 0.01), "log battery_current_A squared"),
        (Cause("heat_source", "cell"), (0.5,), "log what drives it"),
        (Cause("ambient_coupling", None, "charging_on"), (0.5,), "charging_on"),
        (Cause("contact", "shell"), (0.1, 0.5), "temperature of what touches it"),
        (Cause("convection_law"), (0.01, 0.1), "proportional"),
        (Cause("sensor_bias", "cell"), (2.0,), "instrument"),
        (Cause("clock_offset"), (1.0,), "shift the reference"),
    ],
)
def test_what_no_circuit_can_hold_is_left_out_with_its_reason(circuit, cause, values, reason):
    extension = extended_circuit(circuit, model_of(circuit, (cause, *values)))
    assert extension.circuit is None
    (left_out,) = extension.left_out
    assert f"{cause}: " in left_out
    assert reason in left_out
    beside = extended_circuit(circuit, model_of(circuit, (SOURCE, 0.8), (cause, *values)))
    assert beside.left_out == extension.left_out
    assert len(beside.circuit.sources) == 1


def test_what_acts_for_a_while_is_left_out(circuit):
    model = model_of(circuit, (ALL, 0.5))
    from_then_on = replace(model, effects=(replace(model.effects[0], onset_s=900.0, known=False),))
    (left_out,) = extended_circuit(circuit, from_then_on).left_out
    assert "ambient_coupling: it acts for a part of the time" in left_out


def test_what_known_good_records_need_is_held_too(circuit):
    model = model_of(circuit, (PATH, 0.12), (Cause("convection_law"), 0.01, 0.1))
    known = replace(model, effects=tuple(replace(effect, known=True) for effect in model.effects))
    extension = extended_circuit(circuit, known)
    assert extension.circuit.edges[-1].between == ("board", "cell")
    (left_out,) = extension.left_out
    assert "convection_law, as in the known-good records" in left_out


def test_no_circuit_comes_of_what_is_none(circuit):
    extension = extended_circuit(circuit, model_of(circuit, (PATH, -0.12)))
    assert extension.circuit is None
    assert extension.left_out[-1].startswith("The circuit with what was found is none: edges[6].resistance: ")


@pytest.mark.slow
def test_the_extended_circuit_fits_evaluates_and_runs_in_the_daemon(tmp_path, monkeypatch, capsys):
    heat = Hidden("heat_source", "usb", "charger_on", 0.0, None, 0.4)
    train, other = (each.trace for each in simulate_many([("5", 11, (heat,)), ("5", 12, (heat,))], period_s=10.0))
    paths = {name: str(tmp_path / f"{name}.csv") for name in ("train", "other", "estimate")}
    save_trace(paths["train"], train)
    save_trace(paths["other"], other)
    circuit = load_circuit("model2_ss")
    extension = extended_circuit(circuit, found_in(circuit, train))
    assert extension.left_out == ()
    assert extension.circuit.sources == (Source("usb", "charger_on", "k_usb_charger_on"),)
    save_circuit(str(tmp_path / "extended.yaml"), extension.circuit)

    rmse = {}
    for name in ("model2_ss", str(tmp_path / "extended.yaml")):
        model, figures = str(tmp_path / "model.json"), str(tmp_path / "figures.json")
        run(fit, paths["train"], "--circuit", name, "-o", model, "--starts", "2")
        run(evaluate, model, paths["other"], "--json", figures)
        rmse[name] = json.loads((tmp_path / "figures.json").read_text())["traces"][0]["rmse_degC"]
    plain, extended = rmse.values()
    assert extended < 0.75 * plain  # on a run that it never saw

    monkeypatch.setattr("sys.argv", ["ambientd", "replay", model, paths["other"], "-o", paths["estimate"]])
    assert not ambientd()
    capsys.readouterr()
    with open(paths["estimate"], encoding="utf-8") as stream:
        replayed = np.array([float(row["ambient_degC"]) for row in csv.DictReader(stream)])
    # two programs, one number
    assert np.sqrt(np.mean((other.reference - replayed) ** 2)) == pytest.approx(extended, abs=1e-9)


def found_in(circuit, trace):
    """The model of ``circuit`` fitted to ``trace``, then with the heat of the charger in the port."""
    read = forward(circuit)
    trained = CircuitEstimator(read).fit([trace], Effort(starts=2), period_s=10.0)
    values = {each.name: each.initial for each in read.parameters} | {
        each.name: each.value for each in trained.parameters
    }
    plant = Plant.of(read, values, 10.0)
    own = tuple(records_of(read, trace, 10.0))
    model = Model(plant)
    setting = setting_of(model, [view(model, record) for record in own])
    wanted = Cause("heat_source", "usb", "charger_on")
    candidate = next(each for each in all_candidates(setting) if each.cause == wanted)
    start = model.with_effect(Effect(candidate, None, None, np.zeros(1), np.zeros((1, 1))))
    return fit_model(start, TrainingSet(own, residual_noise(model, own)), 2).model


def run(command, *arguments):
    done = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
