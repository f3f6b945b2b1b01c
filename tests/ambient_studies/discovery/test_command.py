"""``ambient-trainer discover``: what it prints and writes, and what an interruption leaves."""

import json
from dataclasses import replace

import pytest

from ambient_studies.discovery.cases import Case
from ambient_studies.discovery.figures import Outcome
from ambient_studies.discovery.runner import Done
from ambient_trainer.diagnosis.result import Cause

BIAS = Cause("sensor_bias", "display")
OUTCOME = Outcome((BIAS,), 9.0, (BIAS,), True, 0.1, -4.0, (0.2, 0.3), 1.5, (0.9,), True, True)
FINISHED = Done(Case(1, 12, (), ()), OUTCOME, ("sensor_bias at display: 4 degC",), ())
PACKAGE = "ambient_studies.discovery"


@pytest.fixture
def asked(monkeypatch):
    """The work is another test's: what the command asks of it."""
    found = {}

    def run(bench, cases, jobs):
        found.update(cases=len(cases), jobs=jobs, numbers=[case.number for case in cases[:2]])
        yield from (replace(FINISHED, case=replace(FINISHED.case, number=number)) for number in (2, 4))

    def baselines(seed, device):
        found["seed"] = seed
        return []

    monkeypatch.setattr(f"{PACKAGE}.cases.baselines", baselines)
    monkeypatch.setattr(f"{PACKAGE}.runner.train", lambda *_: None)
    monkeypatch.setattr(f"{PACKAGE}.runner.run", run)
    return found


def test_figures_and_every_case_for_a_machine(figures, tmp_path, asked):
    found, shown = figures("discover", "--cases", 2, "--jobs", 3)
    assert asked == {"seed": 5000, "cases": 2, "jobs": 3, "numbers": [0, 1]}
    assert (found["seed"], found["circuit"], found["cases"]) == (5000, "phone", 2)
    assert (found["large_effects"]["hits"], found["large_effects"]["cases"]) == (2, 2)
    assert [each.pop("number") for each in found["each"]] == [2, 4]
    cause = {"name": "sensor_bias", "location": "display", "signal": None}
    assert found["each"][0] == {
        "run_seed": 12,
        "true": [cause],
        "size_in_noise": 9.0,
        "found": [cause],
        "correct": True,
        "magnitude_error_frac": 0.1,
        "onset_error_s": -4.0,
        "gain_ci": [0.2, 0.3],
        "seconds": 1.5,
        "confidence": [0.9],
        "named": [{**cause, "confidence": 0.9, "right": True}],
        "onset_right": True,
        "magnitude_right": True,
        "rivals": [],
        "said": ["sensor_bias at display: 4 degC"],
    }
    assert "100.0 %" in shown
    assert shown.endswith(f"Figures: {tmp_path}/figures.json\n")


def test_an_interruption_leaves_what_is_done(trainer, monkeypatch, tmp_path, asked):
    def interrupted(bench, cases, jobs):
        yield FINISHED
        raise KeyboardInterrupt

    monkeypatch.setattr(f"{PACKAGE}.runner.run", interrupted)
    folder, out = tmp_path / "report", tmp_path / "out.json"
    status, _, err = trainer("discover", "--cases", 2, "--json", out, "--report", folder)
    assert (status, "1 of 2 cases" in err) == (1, True)
    assert len(json.loads(out.read_text())["each"]) == 1
    assert "sensor_bias" in (folder / "index.html").read_text()
