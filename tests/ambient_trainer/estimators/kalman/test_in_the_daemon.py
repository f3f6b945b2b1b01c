"""An observer's file in the daemon, from the command line: what was evaluated is what is published."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from ambient_model.codec import load_model
from ambient_trainer.data.trace import load_trace, save_trace
from ambient_trainer.evaluation.evaluate import evaluate_cold

HELD_OUT = 1500


def run(module, *arguments):
    done = subprocess.run([sys.executable, "-m", module, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def write(trace, path, b_until=None):
    """The trace as a file; ``b`` is gone from sample ``b_until`` on."""
    there = np.arange(len(trace.time_s)) < (len(trace.time_s) if b_until is None else b_until)
    b = np.where(there, trace.columns["b_degC"], np.nan)
    save_trace(str(path), replace(trace, columns={**trace.columns, "b_degC": b}))
    return path


@pytest.fixture(scope="module", params=["circuit_observer", pytest.param("free_observer", marks=pytest.mark.slow)])
def exported(request, simulated, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    model = folder / "model.json"
    training = write(simulated(1, samples=2500), folder / "training.csv")
    printed = run("ambient_trainer", "fit", training, "--circuit", request.param, "--starts", 1, "-o", model)
    assert "Noise gain: " in printed
    assert len(load_model(str(model)).main.states) <= 4
    return model


def replayed(model, trace, folder):
    run("ambientd", "replay", model, trace, "-o", folder / "replay.csv")
    lines = (folder / "replay.csv").read_text().splitlines()[1:]
    figures = np.array([[float(cell) for cell in line.split(",")[1:4]] for line in lines])
    return figures.T, [line.rpartition(",")[2] for line in lines]


def test_the_daemon_publishes_what_was_evaluated(exported, simulated, tmp_path):
    trace = write(simulated(2, samples=HELD_OUT), tmp_path / "held_out.csv")
    (ambient, low, high), _ = replayed(exported, trace, tmp_path)
    scored = evaluate_cold(load_model(str(exported)), load_trace(str(trace)))
    for ours, theirs in ((ambient, scored.estimate_degC), (low, scored.low_degC), (high, scored.high_degC)):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    inside = (low <= scored.reference_degC) & (scored.reference_degC <= high)
    assert inside.mean() == pytest.approx(scored.coverage[90], abs=0.002)
    assert 0.85 <= inside.mean() <= 0.95


def test_it_goes_on_without_a_sensor(exported, simulated, tmp_path):
    logged = simulated(2, samples=HELD_OUT)
    gone = HELD_OUT // 2
    (whole, _, _), _ = replayed(exported, write(logged, tmp_path / "whole.csv"), tmp_path)
    (ambient, _, _), status = replayed(exported, write(logged, tmp_path / "gone.csv", gone), tmp_path)
    assert set(status[gone + 15 :]) == {"degraded"}  # what is missing for up to 15 s is replaced
    np.testing.assert_array_equal(ambient[:gone], whole[:gone])
    # where it takes over, the estimate moves no more than the whole model's, and half a degree
    assert abs(ambient[gone] - ambient[gone - 1]) <= abs(whole[gone] - whole[gone - 1]) + 0.5
    left, before = (np.std((logged.reference - each)[gone:]) for each in (ambient, whole))
    assert left < 1.6 * before
