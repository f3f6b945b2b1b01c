"""``ambient-trainer units`` and ``correct``: what they print and write, wrong calls, and Ctrl-C."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys

import pytest

from ambient_model.codec import load_model
from ambient_trainer.data.trace import save_trace


def test_units_prints_writes_and_draws(trainer, saved, free_model, tmp_path):
    figures, report = tmp_path / "out.json", tmp_path / "report"
    options = ("--count", 2, "--scenarios", "1", "--period", 5, "--jobs", 1, "--json", figures, "--report", report)
    status, out, err = trainer("units", saved(free_model), *options)
    assert (status, err) == (0, "")
    found = json.loads(figures.read_text())
    assert found["plan"] == {"count": 2, "seed": 1, "scenarios": ["1"], "period_s": 5.0}
    for group in found["groups"]:
        assert f" {group['as it is']['rmse_degC']['median']:.2f} " in out
    assert out.splitlines()[-2:] == [f"Figures: {figures}", f"Report: {report}/index.html"]
    assert "Scenario 1, in its case" in (report / "index.html").read_text()


def test_correct_writes_a_model_that_is_right_there(trainer, saved, mean, known, tmp_path):
    trace, output = tmp_path / "known.csv", tmp_path / "corrected.json"
    save_trace(str(trace), known(samples=600))
    status, out, err = trainer("correct", saved(mean()), trace, "-o", output, "--from", 300)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    # usb and display are 3 degC off on average, and the offset was 1
    columns = known(samples=600).cut(300, None).columns
    expected = 21 - (columns["usb_degC"] + columns["display_degC"]).mean() / 2 - 1
    assert lines[0].startswith(f"Offset {expected:+.3f} degC (standard error 0.00")
    assert lines[0].endswith("from 300 samples with an ambient.")
    assert [line.split()[0] for line in lines[1:3]] == ["without", "guard"]
    assert lines[-1] == f"Model: {output}"
    model = load_model(str(output))
    assert model.main.offset == pytest.approx(1.0 - 4.0, abs=0.02)
    [said] = model.provenance["corrections"]
    assert (said["trace"], said["from_s"], said["to_s"], said["samples"]) == ("known.csv", 300.0, None, 300)
    assert len(said["sha256"]) == 64
    again = tmp_path / "again.json"
    status, out, _ = trainer("correct", output, trace, "-o", again, "--from", 300)
    assert status == 0
    assert "It is within twice its standard error of nothing" in out


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--count", 1), 2, "1 is not in the range"),
        (("--seed", 0), 2, "0 is not in the range"),
        (("--json", "nowhere/out.json"), 2, "there is no folder "),
        (("--scenarios", "9"), 1, "none is called '9'"),
    ],
)
def test_a_wrong_call_of_units(trainer, saved, mean, arguments, status, message):
    code, out, err = trainer("units", saved(mean()), *arguments)
    assert (code, out) == (status, "")
    assert message in err


def test_a_wrong_call_of_correct(trainer, saved, mean, known, tmp_path):
    trace, model = tmp_path / "known.csv", saved(mean())
    save_trace(str(trace), known(samples=60))
    status, _, err = trainer("correct", model, trace, "-o", model)
    assert (status, "would be overwritten by what is made from it" in err) == (2, True)
    status, _, err = trainer("correct", model, trace, "-o", tmp_path / "o.json", "--from", 5, "--to", 5)
    assert (status, "--from 5 does not come before --to 5" in err) == (2, True)
    status, _, err = trainer("correct", model, trace, "-o", tmp_path / "o.json", "--from", 500)
    assert (status, "too few samples to score" in err) == (1, True)
    assert not (tmp_path / "o.json").exists()


def test_ctrl_c_stops_units_without_a_traceback(saved, free_model, tmp_path):
    terminal, end = pty.openpty()  # the bar shows on a terminal only, and says what is under way
    command = [sys.executable, "-m", "ambient_trainer", "units", saved(free_model), "--jobs", "2"]
    with open(tmp_path / "printed", "w") as printed:
        running = subprocess.Popen([*command, "--json", str(tmp_path / "found.json")], stdout=printed, stderr=end)
    os.close(end)
    seen = b""
    while b"phones" not in seen:
        seen += os.read(terminal, 1024)
    running.send_signal(signal.SIGINT)
    try:
        while piece := os.read(terminal, 1024):
            seen += piece
    except OSError:
        pass  # the other end is closed
    assert running.wait(timeout=60) == 1
    os.close(terminal)
    assert b"stopped" in seen
    assert b"Traceback" not in seen
    assert (tmp_path / "printed").read_text() == ""
    assert not (tmp_path / "found.json").exists()
