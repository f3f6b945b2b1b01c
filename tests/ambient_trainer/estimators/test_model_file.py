"""What was fitted is what the file says, at every period, and the file passes its own test."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from ambient_model.codec import decode, encode
from ambient_model.conformance import TOLERANCE_DEGC, worst_difference_degC
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import Trace, load_trace, save_trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.model_file import model_of, training_of
from ambient_trainer.estimators.registry import CircuitEstimator
from refusals import refused

from ..conftest import CIRCUITS


@pytest.fixture(scope="module")
def trace():
    random = np.random.default_rng(0)
    board = 25 + np.cumsum(random.normal(size=900)) * 0.2
    chip = board + 10 + np.repeat(random.uniform(0, 20, 30), 30)
    power = np.repeat(random.uniform(0, 4, 30), 30)
    ambient = board - 3 - power + random.normal(size=900) * 0.3
    columns = {"board_degC": board, "chip_degC": chip, "cpu_power_W": power, "ambient_degC": ambient}
    return Trace("made.csv", np.arange(900) * 2.0, columns)


@pytest.fixture(scope="module")
def fit(trace):
    return CircuitEstimator(load_circuit(str(CIRCUITS / "driven.yaml"))).fit([trace], Effort(starts=2, seed=7))


@pytest.fixture(scope="module")
def model(fit):
    return model_of(fit, [], {"chip": "soc-therm"})


def test_it_passes_its_own_conformance(model):
    back = decode(encode(model).encode(), "model.json")
    assert back == model
    assert worst_difference_degC(back) <= TOLERANCE_DEGC
    assert set(back.conformance.outputs) == {0.1, 0.2, 0.5, 1.0, 2.0}
    assert len(back.conformance.inputs) >= 24
    assert all(np.ptp(np.array(back.conformance.inputs), axis=0) > 0)


def test_inputs_carry_name_unit_zone_and_the_range_of_the_training(trace, model, fit):
    board, chip, power = model.main.inputs
    assert [(each.name, each.unit, each.zone) for each in model.main.inputs] == [
        ("board", "degC", "board"),
        ("chip", "degC", "soc-therm"),
        ("cpu_power", "W", "cpu_power"),
    ]
    assert [each.column for each in model.main.inputs] == ["board_degC", "chip_degC", "cpu_power_W"]
    assert (board.min, board.max) == (chip.min, chip.max) == (-45.0, 130.0)
    low, high = trace.columns["cpu_power_W"].min(), trace.columns["cpu_power_W"].max()
    assert power.min == pytest.approx(low - (high - low), abs=1e-3)
    assert power.max == pytest.approx(high + (high - low), abs=1e-3)
    sunny = ("board_degC", "chip_degC", "irradiance_W_m2")
    ranges = ((20.0, 115.0), fit.input_ranges[1], (1e-5, 2e-5))  # a photodiode's, say
    board, _, last = model_of(replace(fit, inputs=sunny, input_ranges=ranges), [], {}).main.inputs
    assert (board.min, board.max) == (-45.0, 145.0)
    assert (last.min, last.max) == pytest.approx((0.0, 3e-5), abs=1e-9)
    assert (last.name, last.unit, last.column) == ("irradiance", "W_m2", "irradiance_W_m2")


def test_it_says_the_quantiles_of_the_training_errors_and_how_and_of_what_it_was_made(fit, model, trace, tmp_path):
    errors = np.sort(fit.errors_degC[0])
    for level, (low, high) in model.main.interval.items():
        assert np.mean((errors >= low) & (errors <= high)) == pytest.approx(level / 100, abs=2 / 900)
    found = model.provenance
    assert (found["circuit"], found["periods_s"], found["hold"]) == ("driven", [2.0], "first-order")
    assert found["fit"]["rmse_degC"] == fit.rmse_degC
    assert (found["fit"]["samples"], found["fit"]["seed"], found["fit"]["starts"]) == (900, 7, 2)
    assert set(found["parameters"]) == {"R_chip_board", "R_board", "bias"}
    assert list(found["baseline"]["gains"]) == ["board", "chip", "cpu_power"]
    assert set(found["versions"]) == {"ambientd", "numpy", "scipy", "python"}
    path = tmp_path / "run.csv"
    save_trace(str(path), trace)
    assert training_of(load_trace(str(path)), 10.0, None) == {
        "trace": "run.csv",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "from_s": 10.0,
        "to_s": None,
    }


@pytest.mark.parametrize(
    ("change", "zones", "facts"),
    [
        ({}, {"chip": "soc", "gpu": "gpu0", "dsp": "dsp0"}, ["zones", "dsp, gpu", "board, chip, cpu_power"]),
        ({"outputs": ("board", "chip")}, {}, ["driven", "board, chip"]),
    ],
)
def test_what_no_device_runs_is_refused(fit, change, zones, facts):
    said = str(refused(model_of, replace(fit, **change), [], zones))
    assert all(fact in said for fact in facts)
