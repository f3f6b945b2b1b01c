"""``ambient-trainer mitigate``: what it prints and writes, and models that it refuses."""

import json

import pytest


@pytest.mark.slow
def test_it_prints_writes_and_draws(trainer, saved, model, tmp_path):
    figures, report = tmp_path / "out.json", tmp_path / "report"
    options = ("--room", "5", "--room", "35", "--runs", 1, "--minutes", 20, "--json", figures, "--report", report)
    status, out, err = trainer("mitigate", saved(model), *options)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert "0.126 soc" in out
    assert "soc at 61 degC, 20 degC at 166 degC (" in out
    assert lines[-2:] == [f"Figures: {figures}", f"Report: {report}/index.html"]

    found = json.loads(figures.read_text())
    assert found["simulated"] is True
    assert found["model"] == "free-2"
    assert found["seeds"] == [1]
    assert lines[-4:-2] == found["verdict"]
    rows = {(each["room"], each["told"]): each for each in found["rows"]}
    assert len(rows) == 10
    assert rows["5", "ESTIMATE"]["trusted_frac"] == 1.0
    assert rows["5", "ESTIMATE"]["work_frac"] > rows["5", "HOTTEST"]["work_frac"] + 0.2
    assert rows["35", "USUAL"]["above_limit_min"] > 10
    assert rows["35", "ESTIMATE"]["max_skin_degC"] < found["setting"]["limit_degC"]
    assert found["governor"]["rest_gains"].keys() == {"soc", "ambient"}
    for row in found["rows"]:
        assert f"{row['max_skin_degC']:.1f}" in out
    assert (report / "index.html").stat().st_size > 100_000


def test_the_model_is_not_overwritten(trainer, saved, constant):
    path = saved(constant(20.0))
    status, _, err = trainer("mitigate", path, "--json", path)
    assert status == 2
    assert "would be overwritten by what is made from it" in err


def test_another_devices_model_is_refused(trainer, saved, constant):
    status, _, err = trainer("mitigate", saved(constant(20.0, "ch102")))
    assert status == 1
    assert "inputs: reads ch102_degC, which the simulated phone has no zone for" in err
