"""``ambient-trainer limit``: what it prints and writes."""

import json


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
