"""The circuit with what was found is fitted, evaluated, and run by a device."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.circuits.circuit import Source
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.circuits.write import save_circuit
from ambient_trainer.data.trace import save_trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.file import extended_circuit, greybox_of
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.mechanisms.mass import HiddenMass
from ambient_trainer.diagnosis.greybox.model import Number
from ambient_trainer.simulator.hidden import Hidden
from ambient_trainer.simulator.simulate import simulate_many

CHARGER = Heat(("usb",), (Number("heat_usb", "W", 0.4),), Expression("charger_on"))
MASS = HiddenMass(("usb",), (Number("G_usb_mass", "W/K", 0.1, log=True), Number("lag_usb_mass", "s", 600.0, log=True)))


def test_the_form_stays_where_the_circuits_own_nodes_say_it_all():
    circuit = replace(load_circuit("model2_ss"), about="")
    model = greybox_of(forward(circuit))
    extended = extended_circuit(circuit, model.with_mechanism(CHARGER))
    assert extended.sources == (Source("usb", "charger_on", "k_usb_charger_on"),)
    assert extended.form == circuit.form != forward(circuit).form
    assert extended.about == "with heat_source at usb by charger_on"
    # a body that no sensor reads leaves nothing to estimate the ambient from
    assert extended_circuit(circuit, model.with_mechanism(MASS)).form == forward(circuit).form


@pytest.mark.slow
def test_the_extended_circuit_fits_evaluates_and_runs_in_the_daemon(tmp_path, call):
    heat = Hidden("heat_source", "usb", "charger_on", 0.0, None, 0.4)
    train, other = (each.trace for each in simulate_many([("5", 11, (heat,)), ("5", 12, (heat,))], period_s=10.0))
    paths = {name: str(tmp_path / f"{name}.csv") for name in ("train", "other", "estimate")}
    save_trace(paths["train"], train)
    save_trace(paths["other"], other)
    circuit = load_circuit("model2_ss")
    extended = extended_circuit(circuit, greybox_of(forward(circuit)).with_mechanism(CHARGER))
    save_circuit(str(tmp_path / "extended.yaml"), extended)
    rmse = {}
    for name in ("model2_ss", str(tmp_path / "extended.yaml")):
        model, figures = str(tmp_path / "model.json"), str(tmp_path / "figures.json")
        fitting = ("fit", paths["train"], "--circuit", name, "-o", model, "--starts", "2")
        for command in (fitting, ("evaluate", model, paths["other"], "--json", figures)):
            assert call("ambient-trainer", *command)[0] == 0
        rmse[name] = json.loads((tmp_path / "figures.json").read_text())["traces"][0]["rmse_degC"]
    plain, better = rmse.values()
    assert better < 0.75 * plain  # on a run that it never saw
    assert call("ambientd", "replay", model, paths["other"], "-o", paths["estimate"])[0] == 0
    with open(paths["estimate"], encoding="utf-8") as stream:
        replayed = np.array([float(row["ambient_degC"]) for row in csv.DictReader(stream)])
    # two programs, one number
    assert np.sqrt(np.mean((other.reference - replayed) ** 2)) == pytest.approx(better, abs=1e-9)
