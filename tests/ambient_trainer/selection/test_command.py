"""The command as a process: what it prints and writes, how it stops, and how it goes on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import save_trace

from .conftest import made_up

COMMAND = (sys.executable, "-m", "ambient_trainer", "search")
OPTIONS = ("--most", "2", "--order", "2", "--blocks", "5", "--tolerance", "0.05")


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("traces") / "made-up.csv")
    whole = made_up()
    save_trace(path, replace(whole, columns={**whole.columns, "flat_degC": np.full(len(whole.time_s), 25.0)}))
    return path


def run(*arguments, cwd):
    return subprocess.run([*COMMAND, *arguments], cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def whole(trace, tmp_path_factory):
    """A search that nobody interrupts, and its folder."""
    folder = tmp_path_factory.mktemp("whole")
    done = run(
        trace, *OPTIONS, "--jobs", "1", "--json", "out.json", "--circuits", "circuits", "--report", "page", cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done, folder


def test_it_prints_the_zones_left_out_the_sizes_and_what_to_do_next(whole, trace):
    done, _ = whole
    assert done.stderr == ""
    assert done.stdout.startswith("Left out: flat: constant: 25 degC all the time.\n")
    assert "2 sensors, left and right: " in done.stdout
    assert f"Next: ambient-trainer fit {trace} --circuit free-2 --sensors left,right -o MODEL.json\n" in done.stdout


def test_its_circuits_are_what_fit_takes(whole, trace):
    _, folder = whole
    data = json.loads((folder / "out.json").read_text())
    circuit = load_circuit(str(folder / "circuits" / "search_2.yaml"))
    assert set(circuit.inputs) == {"left_degC", "right_degC"}
    arguments = [
        trace,
        "--circuit",
        "circuits/search_2.yaml",
        "--starts",
        "1",
        "-o",
        "model.json",
        "--json",
        "fit.json",
    ]
    fit = subprocess.run(
        [sys.executable, "-m", "ambient_trainer", "fit", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert fit.returncode == 0, fit.stderr
    held_out = data["sizes"][1]["circuit"]["held_out_rmse_degC"]
    assert json.loads((folder / "fit.json").read_text())["rmse_degC"] < 1.1 * held_out
    assert (folder / "page" / "index.html").exists()


def test_killed_and_started_again_it_finds_the_same(whole, trace, tmp_path):
    _, folder = whole
    state = tmp_path / "state"
    arguments = [*COMMAND, trace, *OPTIONS, "--jobs", "1", "--state", str(state), "--json", "out.json"]
    for lines in (3, 12, 25):
        process = subprocess.Popen(arguments, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _until(lambda lines=lines: state.exists() and state.read_text().count("\n") >= lines, process)
        process.kill()
        process.wait()
    kept = state.read_text()
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert state.read_text().startswith(kept[: kept.rfind("\n") + 1])
    assert (tmp_path / "out.json").read_bytes() == (folder / "out.json").read_bytes()


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_ctrl_c_keeps_what_is_done_and_says_so(trace, tmp_path, jobs):
    state = tmp_path / "state"
    process = subprocess.Popen(
        [*COMMAND, trace, *OPTIONS, "--jobs", jobs, "--state", str(state)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    _until(lambda: state.exists() and state.read_text().count("\n") >= 12, process)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert said == f"Error: stopped; what is done is kept in {state}: the same command goes on from there\n"
    _until(lambda: not _members(process.pid))


def _until(holds, process=None):
    """Wait until it holds, at most a minute."""
    for _ in range(600):
        if holds():
            return
        assert process is None or process.poll() is None, "it ended first"
        time.sleep(0.1)
    pytest.fail("waited in vain")


def _members(group):
    """The processes of a group that still run."""
    found = []
    for each in Path("/proc").iterdir():
        try:
            fields = (each / "stat").read_text().rpartition(")")[2].split()
        except (OSError, IndexError):
            continue
        if len(fields) > 2 and fields[2] == str(group) and fields[0] != "Z":
            found.append(each.name)
    return found


def test_a_changed_trace_makes_the_state_stale(trace, tmp_path):
    state = str(tmp_path / "state")
    quick = ["--most", "1", "--order", "1", "--no-circuits", "--jobs", "1", "--state", state]
    assert run(trace, *quick, cwd=tmp_path).returncode == 0
    other = str(tmp_path / "other.csv")
    save_trace(other, made_up(1))
    done = run(other, *quick, cwd=tmp_path)
    assert done.returncode == 1
    assert "traces: the state was made with [" in done.stderr
    assert "remove it to start anew, or name another --state" in done.stderr
    assert run(trace, *quick[2:], "--most", "2", cwd=tmp_path).returncode == 1


def test_without_a_reference_it_says_what_it_can(tmp_path):
    whole = made_up()
    del whole.columns["ambient_degC"]
    save_trace(str(tmp_path / "t.csv"), replace(whole, columns={**whole.columns, "flat_degC": np.full(1500, 25.0)}))
    done = run("t.csv", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == "Left out: flat: constant: 25 degC all the time.\n"
    assert "t.csv: line 1: no column 'ambient_degC'" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--circuits", "c", "--no-circuits"], 2, "--circuits asks for what --no-circuits leaves out"),
        (["--json", "TRACE"], 2, "would be overwritten by what is made from it"),
        (["--state", "x", "--json", "x"], 2, "stands twice among the outputs"),
        (["--against", "left,skin"], 1, "skin: no such sensor; take of "),
        (["--gap", "nan"], 2, "nan is not a finite number"),
        (["--gap", "1e9"], 1, "beside a block and its gaps 0 samples are left to teach up to "),
        (["--circuits", "TRACE"], 2, "is no folder; name another folder for these files"),
        (["--check", "none.csv"], 1, "none.csv"),
        (["--from", "5000"], 1, "nothing lies between --from and --to"),
        (["--to", "40"], 1, "20 samples for up to "),
        (["--most", "0"], 2, "Invalid value for '--most'"),
    ],
)
def test_a_call_that_cannot_be_done_is_refused(trace, tmp_path, arguments, status, said):
    done = run(trace, *[trace if each == "TRACE" else each for each in arguments], cwd=tmp_path)
    assert done.returncode == status
    assert said in done.stderr
    assert "Traceback" not in done.stderr
