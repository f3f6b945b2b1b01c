"""``ambient-trainer mitigate``: what it prints and writes, and wrong calls."""

from __future__ import annotations

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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--limit", 35), "--limit 35 is not above --hottest 35"),
        (("--seed", 0), "0 is not in the range x>=1"),
        (("--workload", "idle"), "'idle' is not one of 'cpu_100', 'cpu_50', 'camera_1080p', 'camera_4k', 'streaming'"),
        (("--lose", "usb", 1), "Option '--lose' requires 3 arguments"),
        (("--lose", "usb", 5, 5), "--lose usb 5 5 ends before it begins"),
        (("--json", "nowhere/out.json"), "there is no folder "),
    ],
)
def test_a_wrong_call_is_status_2(trainer, saved, saying, arguments, message):
    status, out, err = trainer("mitigate", saved(saying(20.0)), *arguments)
    assert (status, out) == (2, "")
    assert message in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--room", "warm"), "--room: 'warm' is no temperature; write 5, or 35/5/35 for a walk"),
        (("--sensor", "nose"), "--sensor: the simulated phone has no zone 'nose'; it has soc, flash, battery, "),
        (
            ("--lose", "modem", 1, 2),
            "--lose: neither the model nor the governor reads 'modem'; lose one of usb, soc",
        ),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_simulated(
    trainer, saved, saying, monkeypatch, arguments, message
):
    monkeypatch.setattr("ambient_studies.mitigation.comparison.training_trace", None)
    status, out, err = trainer("mitigate", saved(saying(20.0)), *arguments)
    assert (status, out) == (1, "")
    assert err.startswith(f"ambient-trainer: {message}")


def test_the_model_is_not_overwritten(trainer, saved, saying):
    path = saved(saying(20.0))
    status, _, err = trainer("mitigate", path, "--json", path)
    assert status == 2
    assert "would be overwritten by what is made from it" in err


def test_another_devices_model_is_refused(trainer, saved, saying):
    other = saying(20.0)
    inputs = (other.main.inputs[0]._replace(name="ch102"),)
    status, _, err = trainer("mitigate", saved(other._replace(main=other.main._replace(inputs=inputs))))
    assert status == 1
    assert "inputs: reads ch102_degC, which the simulated phone has no zone for" in err
