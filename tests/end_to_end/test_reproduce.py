"""The thesis's protocol as one command: it trains, evaluates, prints, and leaves figures and a page behind."""

import json

import pytest
from scipy.stats import spearmanr

SCENARIOS = {"1", "2.1", "2.2", "2.3", "2.4", "2.5", "3", "4"}
RELATED = {"chau_linear_battery", "he_svr", "ishii_transfer_functions", "li_fixed_point"}
OURS = {"circuit_observer", "free_observer"}


@pytest.mark.slow
def test_every_model_in_every_scenario_beside_the_published_figures(process, tmp_path):
    """One run for all of it: it takes minutes."""
    outputs = ("--json", tmp_path / "found.json", "--report", tmp_path / "report")
    printed = process("ambient_trainer", "reproduce", *outputs, "--seed", "1")
    found = json.loads((tmp_path / "found.json").read_text())
    rows_are_complete(found["rows"])
    our_observers_halve_the_error_of_the_best(found["rows"])
    pairs = [
        (row["published"]["rmse_degC"], row["reproduced"]["rmse_degC"])
        for row in found["rows"]
        if row["published"]
        and row["variant"] == ("noncausal" if row["model"] == "model1_ss_single_input" else "corrected")
    ]
    assert len(pairs) == 60
    assert found["spearman"] == pytest.approx(spearmanr(*zip(*pairs)).statistic)
    assert found["spearman"] >= 0.85
    assert {each["number"] for each in found["errata"]} == {1, 2, 3, 5, 6, 7, 8, 9, 10, 11}
    page = (tmp_path / "report" / "index.html").read_text()
    tables = [f"Table 5.{number}: " for number in range(1, 13)]
    for name in ("Ours: circuit observer", "Ours: free observer", *tables):
        assert name in printed
        assert name in page
    assert f"{found['spearman']:.2f}" in printed
    assert all(line in printed for line in found["shortfalls"])
    assert all(f"Erratum {each['number']}: " in page for each in found["errata"])


def rows_are_complete(rows):
    corrected = {(row["model"], row["scenario"]) for row in rows if row["variant"] == "corrected"}
    models = {model for model, _ in corrected}
    assert models > RELATED
    assert len(models) == 10 + len(RELATED)
    assert corrected == {(model, scenario) for model in models for scenario in SCENARIOS}
    assert {row["variant"] for row in rows} == {"corrected", "as_printed", "noncausal", "published_parameters", "ours"}
    for row in rows:
        assert row["variant"] != "corrected" or row["reproduced"] is not None
        known = row["model"] not in RELATED | OURS and row["scenario"] not in ("2.2", "2.5")
        assert (row["published"] is not None) == known


def our_observers_halve_the_error_of_the_best(rows):
    """In the thesis's verification run, on a device they have never seen in that weather."""
    ours = {(row["model"], row["scenario"]): row["reproduced"] for row in rows if row["variant"] == "ours"}
    assert ours.keys() == {(model, scenario) for model in OURS for scenario in SCENARIOS}
    best = min(
        row["reproduced"]["rmse_degC"]
        for row in rows
        if row["scenario"] == "4" and row["variant"] == "corrected" and row["model"] not in RELATED
    )
    assert all(ours[model, "4"]["rmse_degC"] < 0.5 * best for model in OURS)
