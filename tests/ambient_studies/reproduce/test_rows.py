"""Errors are the thesis's, variants are held against what they can be, and nothing infinite is a figure."""

import json
import math

import numpy as np
import pytest

from ambient_studies.reproduce.reproduction import as_json
from ambient_studies.reproduce.rows import evaluate, like_published, spearman
from ambient_studies.reproduce.runs import EVALUATED, simulated_runs
from ambient_studies.thesis.errata import Erratum
from ambient_trainer.estimators.method import Method


def told(what, done, total):
    assert 0 <= done < total


def test_a_row_has_the_errors_of_its_method(run, method_off_by, published_result):
    published = {("3", "a"): published_result(1.0)}
    found = evaluate([method_off_by("a", 2.0)], {"3": run("3"), "4": run("4")}, published, told)

    third, fourth = found.rows
    assert (third.scenario, third.model, third.variant) == ("3", "a", "corrected")
    assert third.reproduced.rmse_degC == pytest.approx(math.sqrt(2))
    assert third.reproduced.mae_degC == pytest.approx(1.0)
    assert third.reproduced.mbe_degC == pytest.approx(1.0)
    low, high = third.reproduced.interval_degC[98]
    assert (low + high) / 2 == pytest.approx(1.0)
    assert third.published.rmse_degC == 1.0
    assert third.ratio == pytest.approx(math.sqrt(2))
    assert (third.samples, third.without_estimate) == (60, 0)
    assert fourth.published is None
    assert fourth.ratio is None
    assert found.estimates["4", "a", "corrected"].shape == (60,)


@pytest.mark.parametrize("wild", [np.nan, np.inf, 1e200])
def test_what_is_not_finite_is_no_figure(run, wild, published_result):
    method = Method("a", "as_printed", lambda trace: np.full(len(trace.time_s), wild), "wild")
    (row,) = evaluate([method], {"4": run("4")}, {("4", "a"): published_result(1.0)}, told).rows
    assert row.reproduced is None
    assert row.ratio is None


def test_samples_without_an_estimate_are_counted_and_not_scored(run):
    def estimate(trace):
        return np.where(trace.time_s < 10, np.nan, 19.0)

    (row,) = evaluate([Method("a", "corrected", estimate, "late")], {"4": run("4")}, {}, told).rows
    assert (row.samples, row.without_estimate) == (50, 10)
    assert row.reproduced.mbe_degC == pytest.approx(1.0)


def test_the_correlation_takes_the_variant_that_saw_the_reference_for_one_model(made):
    rows = made().evaluated.rows
    compared = like_published(rows)

    assert len(compared) == 60
    assert {row.variant for row in compared if row.model == "model1_ss_single_input"} == {"noncausal"}
    assert {row.variant for row in compared if row.model != "model1_ss_single_input"} == {"corrected"}
    # ten ranks of six each: all in order, but the third, which was moved to the front
    assert spearman(compared) == pytest.approx(1 - 6 * 6 * (1 + 1 + 4) * 36 / (60 * (60**2 - 1)), abs=0.01)


def test_a_correlation_needs_three_that_differ(made):
    rows = like_published(made().evaluated.rows)
    assert spearman(rows[:2]) is None
    assert spearman([]) is None


def test_json_holds_ten_models_and_four_methods_in_eight_scenarios(made):
    reproduction = made()
    erratum = Erratum(1, "a title", "a statement", (("what", 1.5, "degC"),))
    data = json.loads(json.dumps(as_json(reproduction, [erratum]), allow_nan=False))

    corrected = [(row["scenario"], row["model"]) for row in data["rows"] if row["variant"] == "corrected"]
    assert len(corrected) == len(set(corrected)) == 14 * 8
    for row in data["rows"]:
        assert row["reproduced"].keys() >= {"rmse_degC", "mae_degC", "mbe_degC", "interval_degC"}
        known = row["scenario"] not in ("2.2", "2.5") and "20" not in row["model"] and row["model"] not in (
            "chau_linear_battery", "he_svr", "ishii_transfer_functions", "li_fixed_point",
            "circuit_observer", "free_observer",
        )  # fmt: skip
        assert (row["published"] is not None) == known
    assert data["simulated"] is True
    assert data["spearman"] == reproduction.verdict.spearman
    assert data["errata"] == [
        {
            "number": 1,
            "title": "a title",
            "statement": "a statement",
            "figures": [{"what": "what", "value": 1.5, "unit": "degC"}],
        }
    ]


def test_no_two_runs_share_their_weather(monkeypatch):
    from ambient_studies.reproduce import runs

    asked = []

    def simulate_many(wanted, progress):
        asked.extend(wanted)
        return list(wanted)

    monkeypatch.setattr(runs, "simulate_many", simulate_many)
    for seed in (0, 1, 2):
        found = simulated_runs(seed, told)
    seeds = [seed for _, seed in asked]
    assert len(set(seeds)) == len(seeds) == 30
    assert found.training[0] == "5"
    assert found.idle[0] == "1"
    assert found.idle != found.evaluated["1"]
    assert [name for name, _ in found.evaluated.values()] == list(EVALUATED)
