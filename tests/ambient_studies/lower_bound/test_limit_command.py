"""``ambient-trainer limit``: what it prints and writes, and wrong calls."""

from __future__ import annotations

import json

import pytest


def test_it_prints_and_writes(trainer, saved, constant, tmp_path):
    figures = tmp_path / "out.json"
    options = ("--scenarios", "1,2.5", "--seeds", "3", "--fitted", 2, "--period", 5, "--json", figures)
    status, out, err = trainer("limit", saved(constant(22.0)), *options)
    assert (status, err) == (0, "")
    found = json.loads(figures.read_text())
    assert [each["scenario"] for each in found["scenarios"]] == ["1", "2.5"]
    assert found["simulated"] is True
    for each in found["scenarios"]:
        assert f" {each['model_rmse_degC']:.3f} " in out
    assert "simulated" in out


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--seeds", "3;4"), 2, "--seeds '3;4'"),
        (("--seeds", ""), 2, "--seeds ''"),
        (("--fitted", 0), 2, "0 is not in the range"),
        (("--json", "nowhere/out.json"), 2, "there is no folder "),
        (("--scenarios", "9"), 1, "'9'"),
    ],
)
def test_a_wrong_call(trainer, saved, constant, arguments, status, message):
    code, out, err = trainer("limit", saved(constant(20.0)), *arguments)
    assert (code, out) == (status, "")
    assert message in err
