"""Another kind of device than a phone, a set-top box with a fan, is simulated, fitted and diagnosed."""

import json
from pathlib import Path

import numpy as np
import pytest

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.registry import CircuitEstimator
from ambient_trainer.simulator import load_device, simulate
from ambient_trainer.simulator.device import device_path
from ambient_trainer.simulator.heat import HeatBalance
from refusals import refused, refused_places

DAY = "set_top_box"


@pytest.fixture(scope="module")
def day():
    return simulate(DAY, "set_top_box", seed=1, period_s=60.0).trace


def test_it_logs_its_sensors_its_drives_and_its_fan(day):
    zones = [f"{name}_degC" for name in load_device("set_top_box").sensors]
    assert list(day.columns) == [*zones, "ambient_degC", "soc_power_W", "disk_on", "cpu_load_frac", "fan_frac"]
    fan, soc = day.column("fan_frac"), day.column("soc_degC")
    assert fan[soc < 44].max() == 0.0
    assert fan[soc > 70].min() > 0.8
    assert day.column("disk_on").mean() == pytest.approx(90 / 270, abs=0.01)
    assert 60 < soc.max() < 100


def test_the_fan_carries_the_heat_of_the_air_inside():
    box = load_device("set_top_box")
    still = box.with_values({"fan.vents_W_K.air": 0.0})
    nodes, outside = np.full((1, len(box.nodes)), 80.0), np.array([30.0])
    more_W = HeatBalance([box]).lost(nodes, outside) - HeatBalance([still]).lost(nodes, outside)
    assert more_W[0] == pytest.approx(box.pattern({"air": 1.5 * 50.0}))


def test_filters_and_a_circuit_are_fitted_to_it(day):
    free = FreeFilterEstimator(2).fit([day], Effort(starts=2))
    circuit = CircuitEstimator(load_circuit("set_top_box")).fit([day], Effort(starts=1))
    assert free.rmse_degC < 2.0
    assert circuit.rmse_degC < 1.5


@pytest.mark.slow
def test_hidden_heat_is_found_in_it():
    known_good = simulate(DAY, "set_top_box", 1, 30.0).trace
    run = simulate(DAY, "set_top_box", 5, 30.0, ["heat_source:board:1.5W:from=90min:to=200min"], decoys=["wifi_on"])
    first = diagnose(load_circuit("set_top_box"), [run.trace], [known_good]).steps[0]
    assert (first.cause.name, first.cause.location) == ("heat_source", "board")
    assert first.magnitude.value == pytest.approx(run.truths[0].magnitude, rel=0.5)  # the fan hides a part
    assert first.onset_s == pytest.approx(5400.0, abs=300.0)


def test_a_user_s_device_and_scenario_are_one_file_each(trainer, tmp_path):
    brick = tmp_path / "brick.yaml"
    brick.write_text(
        "about: A block with a heater\n"
        "nodes: {core: {capacitance_J_K: 50}, skin: {capacitance_J_K: 200, surface_m2: 0.02}}\n"
        "conductance_W_K: {core-skin: 0.5}\n"
        "convection_W_m2_K125: 2.0\n"
        "processor: {node: core, logs: heater_power_W}\n"
        "activities: {rest: {}, heated: {heat_W: {core: 5.0}}}\n"
        "sensors: [core]\n"
        "zones: [{name: core, near: core, sensor: thermistor, lag_s: 5, noise_degC: 0.05, step_degC: 0.1}]\n"
        "chamber: {heating_K_min: 2, cooling_K_min: 2, wobble_degC: 0.2}\n"
    )
    scenario = tmp_path / "warm.yaml"
    scenario.write_text(
        "about: Heated\nsteps:\n  - {duration_min: 10, chamber_degC: 20}\n"
        "  - {duration_min: 60, chamber_degC: 40, gradient_K_min: 0.5, load: [heated]}\n"
    )
    out, truth = tmp_path / "t.csv", tmp_path / "t.json"
    hidden = ("--hide", "heat_source:core:2W:from=30min", "--truth", truth)
    assert trainer("simulate", scenario, "--device", brick, "--period", 20, *hidden, "-o", out)[0] == 0
    (told,) = json.loads(truth.read_text())["effects"]
    assert (told["cause"], told["sensor_location"], told["worst"]) == ("heat_source", "core", "core_degC")
    trace = simulate(str(scenario), str(brick), period_s=20.0).trace
    assert list(trace.columns) == ["core_degC", "ambient_degC", "heater_power_W"]
    air = trace.column("ambient_degC")
    assert air[trace.time_s == 1200][0] == pytest.approx(25.0, abs=1.0)  # ten minutes at 0.5 K/min
    assert trace.column("core_degC")[-1] > air[-1] + 8


def test_a_faulty_device_is_refused_with_every_place(write):
    text = Path(device_path("phone")).read_text()
    path = write("phone.yaml", text.replace("low: 0.024", "low: 0.3"))
    assert "activities.idle.heat_W.soc" in str(refused(load_device, path))
    write("phone.yaml", text.replace("near: flash", "near: moon").replace("sensors: [soc", "sensors: [sun"))
    assert {*refused_places(load_device, path)} == {"zones.flash", "sensors"}
    assert "phone, set_top_box" in str(refused(load_device, "toaster"))
    assert "streaming" in str(refused(simulate, "2.1", "set_top_box"))  # a load that the box does not know
