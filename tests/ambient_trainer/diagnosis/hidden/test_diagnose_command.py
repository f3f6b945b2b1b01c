"""``ambient-trainer diagnose`` as a process: what it prints and writes, what that is good for, and its refusals."""

import html
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ambient_model.codec import load_model
from ambient_trainer.data.trace import save_trace
from ambient_trainer.simulator.phone import simulate

LID = Path(__file__).parents[3] / "data" / "circuits" / "lid.yaml"
STEP = {"cause", "location", "signal", "onset_s", "end_s", "magnitude", "confidence", "gain", "indistinguishable_from",
        "sentence", "parameters"}  # fmt: skip
WHOLE = {"trace", "circuit", "baselines", "steps", "verdict", "ranking", "residuals", "next_experiment",
         "candidates_tried", "notes"}  # fmt: skip


def called(*arguments, folder=None):
    """Status, what was printed, what was said on standard error."""
    command = [sys.executable, "-m", "ambient_trainer", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=folder)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def folder(boxed, tmp_path_factory):
    """A circuit, a trace with a radio that it knows nothing of, and a known-good one."""
    where = tmp_path_factory.mktemp("diagnose")
    shutil.copy(LID, where)
    for name, trace in (("day.csv", boxed("heat_source", 1)), ("good.csv", boxed("none", 101))):
        save_trace(str(where / name), trace)
    return where


@pytest.fixture(scope="module")
def done(folder):
    """The whole command, once: what it printed."""
    status, printed, said = called(
        *("diagnose", "day.csv", "--circuit", "lid.yaml", "--baseline", "good.csv"),
        *("--json", "out.json", "--report", "page", "--extended", "lid_extended.yaml"),
        folder=folder,
    )
    assert status == 0, said
    assert said == ""  # a bar is for terminals
    return printed


def test_the_terminal_names_the_cause(done):
    assert done.startswith("day.csv, lid\nHeat that the circuit does not know, at shell, driven by radio_on, all the ")
    for written in ("Figures: out.json", "Circuit: lid_extended.yaml", "Report: page/index.html"):
        assert written in done.splitlines()
    assert max(map(len, done.splitlines()[2:20])) <= 140


def test_every_key_of_the_contract_is_there(done, folder):
    told = json.loads((folder / "out.json").read_text())
    assert told.keys() == WHOLE
    assert (told["trace"], told["circuit"], told["baselines"]) == ("day.csv", "lid", ["good.csv"])
    assert told["verdict"] == told["steps"][0]
    assert told["verdict"]["cause"] == "heat_source"
    assert (told["verdict"]["location"], told["verdict"]["signal"]) == ("shell", "radio_on")
    assert (told["verdict"]["onset_s"], told["verdict"]["end_s"]) == (None, None)
    for step in told["steps"]:
        assert step.keys() == STEP
        assert 0 <= step["confidence"] <= 1
        assert step["magnitude"].keys() == {"value", "unit", "meaning", "ci95"}
        assert step["magnitude"]["ci95"][0] <= step["magnitude"]["value"] <= step["magnitude"]["ci95"][1]
        check_gain(step["gain"])
        assert step["gain"]["ci95_degC"][0] > 0
        assert all(each.keys() == {"cause", "location", "signal"} for each in step["indistinguishable_from"])
        assert all(each.keys() == {"value", "unit"} for each in step["parameters"].values())
    for ranked in told["ranking"]:
        assert ranked.keys() == {"cause", "location", "signal", "onset_s", "end_s", "magnitude", "gain", "remark"}
        check_gain(ranked["gain"])
    assert [each["remark"] for each in told["ranking"]].count("taken") == 1
    assert told["candidates_tried"] > len(told["ranking"])
    assert told["residuals"].keys() == {"sensors", "heat_unit", "tests"}
    assert told["residuals"]["heat_unit"] == "K/s"  # no power is known to this circuit
    assert told["residuals"]["sensors"].keys() == {"board", "shell"}
    for sensor in told["residuals"]["sensors"].values():
        assert sensor.keys() == {"rmse_degC", "std_degC", "memory_s"}
    for test in told["residuals"]["tests"]:
        assert test.keys() == {"name", "subject", "statistic", "threshold", "significant", "sentence"}
    assert isinstance(told["next_experiment"], str)


def check_gain(gain):
    assert gain.keys() == {"rmse_before_degC", "rmse_after_degC", "ci95_degC", "p_value", "held_out"}
    assert gain["held_out"] is True
    assert 0 <= gain["p_value"] <= 1


def test_the_extended_circuit_fits_with_what_was_found(done, folder):
    status, _, said = called(
        *("fit", "day.csv", "--circuit", "lid_extended.yaml", "-o", "lid.json", "--starts", "1"), folder=folder
    )
    assert status == 0, said
    inputs = [each.name for each in load_model(str(folder / "lid.json")).main.inputs]
    assert sorted(inputs) == ["board", "chip", "radio", "shell"]


def test_the_page_opens_in_a_browser(done, folder, opened):
    page = (folder / "page" / "index.html").read_text()
    assert "Heat that the circuit does not know, at shell, driven by radio_on" in html.unescape(page)
    names = re.findall(r'<div id="(\w+)" class="plotly-graph-div"', page)
    assert names == ["gains", "simulated", "heat", "residuals", "ambient"]
    said = opened(page, 1280)
    assert said["faults"] == []
    # a panel a sensor, and one for the gain, the signal and the ambient: drawn, not only asked for
    assert len(said["plots"]) == 3 * 2 + 3
    assert min(said["plots"]) > 500


@pytest.fixture(scope="module")
def others(folder):
    """The folder, with what a wrong call may name besides."""
    (folder / "a_folder").mkdir(exist_ok=True)
    lines = (folder / "day.csv").read_text()
    (folder / "renamed.csv").write_text(lines.replace("shell_degC", "lid_degC"))
    return folder


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        ("day.csv --circuit nosuch", 1, "no circuit is called 'nosuch'; take one of "),
        ("nothere.csv --circuit lid.yaml", 1, "nothere.csv: cannot be read"),
        ("renamed.csv --circuit lid.yaml", 1, "renamed.csv: line 1: no column 'shell_degC'; it has "),
        ("day.csv --circuit lid.yaml --baseline renamed.csv", 1, "renamed.csv: line 1: no column 'shell_degC'"),
        ("day.csv --circuit lid.yaml --from 99999", 1, "nothing lies between --from and --to"),
        ("day.csv --circuit lid.yaml --to 200", 1, "20 samples tell nothing of a cause; log at least 100"),
        ("day.csv --circuit lid.yaml --json day.csv", 2, "day.csv: would be overwritten by what is made from it"),
        ("day.csv --circuit lid.yaml --extended lid.yaml", 2, "lid.yaml: would be overwritten by what is made from it"),
        ("day.csv --circuit lid.yaml --json a_folder", 2, "a_folder: "),
        ("day.csv --circuit lid.yaml --json a --extended a", 2, "a: stands twice among the outputs"),
        ("day.csv", 2, "Missing option '--circuit'"),
        ("--circuit lid.yaml", 2, "Missing argument 'TRACE...'"),
    ],
)
def test_a_wrong_call_says_what_to_do(others, arguments, status, words):
    before = {each.name: each.read_bytes() for each in others.glob("*.*") if each.is_file()}
    left, printed, said = called("diagnose", *arguments.split(), folder=others)
    assert left == status
    assert words in said
    assert printed == ""
    assert before == {each.name: each.read_bytes() for each in others.glob("*.*") if each.is_file()}


def test_ctrl_c_stops_it_and_writes_nothing(tmp_path):
    trace, out = tmp_path / "phone.csv", tmp_path / "out.json"
    save_trace(str(trace), simulate("3", seed=1, period_s=5.0))
    terminal, end = pty.openpty()  # the bar shows on a terminal only, and says what is under way
    arguments = ["diagnose", str(trace), "--circuit", "phone", "--json", str(out)]
    running = subprocess.Popen(
        [sys.executable, "-m", "ambient_trainer", *arguments], stdout=subprocess.PIPE, stderr=end, text=True
    )
    os.close(end)
    seen = b""
    while b"teach" not in seen:
        seen += os.read(terminal, 1024)
    running.send_signal(signal.SIGINT)
    said = seen + everything(terminal)
    printed, _ = running.communicate(timeout=60)
    assert running.returncode == 1
    assert b"ambient-trainer: stopped" in said
    assert b"Traceback" not in said
    assert printed == ""
    assert list(tmp_path.iterdir()) == [trace]


def everything(terminal):
    """What a process writes until it ends, and with it its terminal."""
    found = b""
    try:
        while part := os.read(terminal, 1024):
            found += part
    except OSError:
        pass
    os.close(terminal)
    return found
