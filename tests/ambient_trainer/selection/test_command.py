"""The command as a process: what it prints and writes, how it stops, and how it goes on."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.cli.commands.search import command
from ambient_trainer.data.trace import load_trace, save_trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.registry import CircuitEstimator

from .conftest import made_up

COMMAND = (sys.executable, "-m", "ambient_trainer", "search")
OPTIONS = ("--most", "2", "--order", "2", "--blocks", "5", "--tolerance", "0.05")


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("traces") / "made up.csv")
    whole = made_up(count=750)
    save_trace(path, replace(whole, columns={**whole.columns, "flat_degC": np.full(len(whole.time_s), 25.0)}))
    return path


@pytest.fixture(scope="module")
def whole(trace, tmp_path_factory):
    """The output of a search that nobody interrupts, and its folder."""
    folder = tmp_path_factory.mktemp("whole")
    outputs = {"--json": "out.json", "--circuits": "circuits", "--report": "page"}
    written = [word for option, name in outputs.items() for word in (option, str(folder / name))]
    done = CliRunner().invoke(command, [trace, *OPTIONS, "--jobs", "1", *written], catch_exceptions=False)
    assert (done.exit_code, done.stderr) == (0, "")
    return done.stdout, folder


def test_it_prints_the_zones_left_out_the_sizes_and_what_to_do_next(whole, trace):
    lines = whole[0].splitlines()
    assert lines[0].startswith("Left out: flat: ")
    assert "25 degC" in lines[0]
    assert [line for line in lines if line.startswith("2 sensors, left and right: ")]
    assert [line for line in lines if f"fit '{trace}' --circuit free-2 --sensors left,right -o MODEL.json" in line]


def test_its_circuits_are_what_fit_takes(whole, trace):
    folder = whole[1]
    circuit = load_circuit(str(folder / "circuits" / "search_2.yaml"))
    assert set(circuit.inputs) == {"left_degC", "right_degC"}
    fit = CircuitEstimator(circuit).fit([load_trace(trace)], Effort(starts=1))
    data = json.loads((folder / "out.json").read_text())
    assert fit.rmse_degC < 1.1 * data["sizes"][1]["circuit"]["held_out_rmse_degC"]
    assert (folder / "page" / "index.html").exists()


def reached(state, size, process):
    assert process.poll() is None, "it ended first"
    return state.exists() and state.stat().st_size >= size


@pytest.mark.slow
def test_killed_and_started_again_it_finds_the_same(whole, trace, tmp_path, until):
    state = tmp_path / "state"
    arguments = [*COMMAND, trace, *OPTIONS, "--jobs", "1", "--state", str(state), "--json", "out.json"]
    for size in (12_000, 16_000):
        with subprocess.Popen(arguments, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            until(lambda size=size: reached(state, size, process), seconds=60)
            process.kill()
    subprocess.run(arguments, cwd=tmp_path, capture_output=True, timeout=120, check=True)
    assert (tmp_path / "out.json").read_bytes() == (whole[1] / "out.json").read_bytes()


@pytest.mark.parametrize("jobs", ["1", pytest.param("2", marks=pytest.mark.slow)])
def test_ctrl_c_keeps_what_is_done_and_leaves_no_process(trace, tmp_path, until, jobs):
    state = tmp_path / "state"
    process = subprocess.Popen(
        [*COMMAND, trace, *OPTIONS, "--jobs", jobs, "--state", str(state)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    until(lambda: reached(state, 12_000, process), seconds=60)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert errors.startswith("Error: stopped; ")
    assert str(state) in errors
    assert "Traceback" not in errors
    until(lambda: not _is_group(process.pid), seconds=60)


def _is_group(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
