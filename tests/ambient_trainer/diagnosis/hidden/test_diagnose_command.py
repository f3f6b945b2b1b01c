"""``ambient-trainer diagnose`` as a process: what it prints and writes, the use of that, and its refusals."""

import json
import shutil
import sys
from pathlib import Path

import pytest

from ambient_model.codec import load_model
from ambient_trainer.data.trace import save_trace
from ambient_trainer.simulator.simulate import simulate
from processes import ran

TRAINER = (sys.executable, "-m", "ambient_trainer")
LID = Path(__file__).parents[3] / "data" / "circuits" / "lid.yaml"
CAUSE = {"cause", "location", "signal"}
EFFECT = CAUSE | {"onset_s", "end_s", "magnitude", "gain"}
STEP = EFFECT | {"confidence", "indistinguishable_from", "sentence", "parameters"}
WHOLE = {"trace", "circuit", "baselines", "steps", "verdict", "ranking", "residuals", "next_experiment",
         "candidates_tried", "notes"}  # fmt: skip
LATER_S = "9000"
GAIN = {"rmse_before_degC", "rmse_after_degC", "ci95_degC", "p_value", "held_out"}


@pytest.fixture(scope="module")
def folder(boxed, tmp_path_factory):
    """A circuit, a trace with a radio that the circuit lacks, and a known-good one."""
    where = tmp_path_factory.mktemp("diagnose")
    shutil.copy(LID, where)
    for name, trace in (("day.csv", boxed("heat_source", 1)), ("good.csv", boxed("none", 101))):
        save_trace(str(where / name), trace)
    return where


@pytest.fixture(scope="module")
def done(folder):
    """The whole command, once: what it printed."""
    done = ran(
        *(*TRAINER, "diagnose", "day.csv", "--circuit", "lid.yaml", "--baseline", "good.csv"),
        *("--json", "out.json", "--report", "page", "--extended", "lid_extended.yaml", "--later", LATER_S),
        cwd=folder,
        timeout=120,
    )
    assert done.stderr == ""  # a bar is for terminals
    return done.stdout


def test_the_terminal_names_the_cause(done):
    title, headline, *lines = done.splitlines()
    assert "day.csv, lid: heat_source at shell by radio_on" in title
    assert "at shell, driven by radio_on, all the time" in headline
    for name in ("out.json", "lid_extended.yaml", "page/index.html"):
        assert any(line.endswith(name) for line in lines)
    assert max(len(line) for line in lines if "→" in line) <= 140


def test_every_key_of_the_contract_is_there(done, folder):
    data = json.loads((folder / "out.json").read_text())
    assert data.keys() >= WHOLE
    assert (data["trace"], data["circuit"], data["baselines"]) == ("day.csv", "lid", ["good.csv"])
    verdict = data["verdict"]
    assert verdict == data["steps"][0]
    assert (verdict["cause"], verdict["location"], verdict["signal"]) == ("heat_source", "shell", "radio_on")
    assert (verdict["onset_s"], verdict["end_s"]) == (None, None)
    for step in data["steps"]:
        assert step.keys() >= STEP
        assert 0 <= step["confidence"] <= 1
        assert step["gain"]["ci95_degC"][0] > 0
        low, high = step["magnitude"]["ci95"]
        assert low <= step["magnitude"]["value"] <= high
        assert all(each.keys() == CAUSE for each in step["indistinguishable_from"])
        assert all(each.keys() == {"value", "unit"} for each in step["parameters"].values())
    for ranked in data["ranking"]:
        assert ranked.keys() >= EFFECT | {"remark"}
        assert ranked["gain"].keys() == GAIN
        assert ranked["gain"]["held_out"] is True
        assert 0 <= ranked["gain"]["p_value"] <= 1
    assert [each["remark"] for each in data["ranking"]].count("taken") == 1
    effects = [
        tuple(map(str, (each[key] for key in ("cause", "location", "signal", "onset_s", "end_s"))))
        for each in data["ranking"]
    ]
    assert len(set(effects)) == len(effects)
    assert data["candidates_tried"] > len(data["ranking"])
    assert data["residuals"]["heat_unit"] == "K/s"  # this circuit has no power
    assert data["residuals"]["sensors"].keys() == {"board", "shell"}
    for sensor in data["residuals"]["sensors"].values():
        assert sensor.keys() == {"rmse_degC", "std_degC", "memory_s"}
    tests = data["residuals"]["tests"]
    assert any("radio_on" in test["subject"] and test["significant"] for test in tests)
    for test in tests:
        assert test.keys() == {"name", "subject", "statistic", "threshold", "significant", "sentence"}
    assert isinstance(data["next_experiment"], str)
    later = data["later"]
    assert (later.keys(), later["from_s"]) == ({"from_s", "bare_rmse_degC", "extended_rmse_degC", "samples"}, 9000)
    assert later["samples"] == 180
    assert later["extended_rmse_degC"] < 0.5 * later["bare_rmse_degC"]


def test_the_extended_circuit_fits_with_the_step(done, folder):
    fit = ("fit", "day.csv", "--circuit", "lid_extended.yaml", "-o", "lid.json", "--starts", "1")
    ran(*TRAINER, *fit, cwd=folder, timeout=120)
    inputs = [each.name for each in load_model(str(folder / "lid.json")).main.inputs]
    assert sorted(inputs) == ["board", "chip", "radio", "shell"]


def test_ctrl_c_stops_it_and_writes_nothing(interrupted, tmp_path):
    save_trace(str(tmp_path / "phone.csv"), simulate("3", seed=1, period_s=5.0).trace)
    out = ("--json", tmp_path / "out.json")
    status, printed, shown = interrupted("fit", "diagnose", tmp_path / "phone.csv", "--circuit", "phone", *out)
    assert (status, printed) == (1, "")
    assert "ambient-trainer: stopped" in shown
    assert "Traceback" not in shown
    assert {each.name for each in tmp_path.iterdir()} == {"phone.csv", "printed"}
