"""``ambient-trainer discover``: what it prints and writes, and what an interruption leaves."""

import json
import sys
from dataclasses import replace

import pytest

from ambient_studies.discovery.cases import Case
from ambient_studies.discovery.outcome import Outcome
from ambient_studies.discovery.runner import Done
from ambient_studies.discovery.score import Scored
from ambient_trainer.cli.main import main
from ambient_trainer.diagnosis.result import Cause


def _run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["ambient-trainer", "discover", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    return stopped.value.code


BIAS = Cause("sensor_bias", "display")
OUTCOME = Outcome((BIAS,), 9.0, (BIAS,), True, 0.1, -4.0, (0.2, 0.3), 1.5)
FINISHED = Done(Case(1, 12, (), ()), Scored(OUTCOME, True, True), ("sensor_bias at display: 4 degC",), ())
PACKAGE = "ambient_studies.discovery"


@pytest.fixture
def asked(monkeypatch):
    """The work is another test's: what the command asks of it."""
    told = {}

    def run(bench, cases, jobs, waiting):
        told.update(cases=len(cases), jobs=jobs, numbers=[case.number for case in cases[:2]])
        waiting()
        yield from (replace(FINISHED, case=replace(FINISHED.case, number=number)) for number in (4, 2))

    def baselines(seed):
        told["seed"] = seed
        return []

    monkeypatch.setattr(f"{PACKAGE}.cases.baselines", baselines)
    monkeypatch.setattr(f"{PACKAGE}.runner.teach", lambda *_: None)
    monkeypatch.setattr(f"{PACKAGE}.runner.run", run)
    return told


def test_figures_and_every_case_for_a_machine(monkeypatch, capsys, tmp_path, asked):
    out = tmp_path / "out.json"
    assert _run(monkeypatch, "--cases", "2", "--jobs", "3", "--json", str(out)) == 0
    assert asked == {"seed": 5000, "cases": 2, "jobs": 3, "numbers": [0, 1]}
    told = json.loads(out.read_text())
    assert (told["seed"], told["circuit"], told["cases"]) == (5000, "phone", 2)
    assert (told["large_effects"]["hits"], told["large_effects"]["cases"]) == (2, 2)
    assert [each.pop("number") for each in told["each"]] == [2, 4]
    cause = {"name": "sensor_bias", "location": "display", "signal": None}
    assert told["each"][0] == {
        "run_seed": 12,
        "true": [cause],
        "size_in_noise": 9.0,
        "found": [cause],
        "correct": True,
        "magnitude_error_frac": 0.1,
        "onset_error_s": -4.0,
        "gain_ci": [0.2, 0.3],
        "seconds": 1.5,
        "onset_right": True,
        "magnitude_right": True,
        "rivals": [],
        "said": ["sensor_bias at display: 4 degC"],
    }
    said = capsys.readouterr()
    assert "cause, place and signal are right in 100.0 %" in said.out
    assert said.out.endswith(f"Figures: {out}\n")
    assert said.err == ""


def test_an_interruption_leaves_what_is_done(monkeypatch, capsys, tmp_path, asked):
    def interrupted(bench, cases, jobs, waiting):
        yield FINISHED
        raise KeyboardInterrupt

    monkeypatch.setattr(f"{PACKAGE}.runner.run", interrupted)
    folder, out = tmp_path / "report", tmp_path / "out.json"
    assert _run(monkeypatch, "--cases", "2", "--json", str(out), "--report", str(folder)) == 1
    assert len(json.loads(out.read_text())["each"]) == 1
    assert "sensor_bias" in (folder / "index.html").read_text()
    assert capsys.readouterr().err == "Error: interrupted after 1 of 2 cases: the figures are of these\n"


def test_an_interruption_before_any_case_says_so(monkeypatch, capsys, asked):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"{PACKAGE}.runner.teach", interrupted)
    assert _run(monkeypatch) == 1
    assert capsys.readouterr() == ("", "\nambient-trainer: stopped\n")


def test_a_circuit_that_is_none_is_refused(monkeypatch, capsys):
    assert _run(monkeypatch, "--circuit", "phones") == 1
    assert "no circuit is called 'phones'" in capsys.readouterr().err


def test_a_circuit_has_to_read_every_sensor(monkeypatch, capsys, asked):
    assert _run(monkeypatch, "--circuit", "model2_ss") == 2
    assert "model2_ss: no node with a capacitance is read by display, soc; take" in capsys.readouterr().err
    assert asked == {}
