"""``ambient-trainer units``: what it prints and writes, and Ctrl-C."""

import json

import pytest


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


@pytest.mark.slow
def test_ctrl_c_stops_units_without_a_traceback(interrupted, saved, free_model, tmp_path):
    words = ("units", saved(free_model), "--jobs", "2", "--period", "10", "--json", tmp_path / "found.json")
    status, printed, shown = interrupted("phones", *words)
    assert (status, printed) == (1, "")
    assert "stopped" in shown
    assert "Traceback" not in shown
    assert not (tmp_path / "found.json").exists()
