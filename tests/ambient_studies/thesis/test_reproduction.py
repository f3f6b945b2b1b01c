"""Rows, correlation, verdict, tables and JSON of a reproduction whose methods have known errors."""

import io
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from ambient_studies.thesis import reproduction
from ambient_studies.thesis.errata import Erratum, Figure, text_errata
from ambient_studies.thesis.methods import Method
from ambient_studies.thesis.names import TABLES
from ambient_studies.thesis.published import MODELS, NONCAUSAL
from ambient_studies.thesis.report import report_of
from ambient_studies.thesis.reproduction import EVALUATED, as_json, simulated_runs
from ambient_studies.thesis.rows import evaluate, like_published, spearman
from ambient_studies.thesis.tables import overview_table, scenario_tables
from ambient_studies.thesis.verdict import verdict
from ambient_trainer.report.terminal import print_report

from .synthetic import off_by, published_as, run_of, synthetic_reproduction


def quiet(what, done, total):
    assert 0 <= done < total


@pytest.fixture
def done():
    return synthetic_reproduction()


def test_a_row_has_the_errors_of_its_method():
    found = evaluate([off_by("a", 2.0)], {"3": run_of("3"), "4": run_of("4")}, {("3", "a"): published_as(1.0)}, quiet)
    third, fourth = found.rows
    assert (third.scenario, third.model, third.variant) == ("3", "a", "corrected")
    assert third.reproduced.rmse_degC == pytest.approx(math.sqrt(2))
    assert (third.reproduced.mae_degC, third.reproduced.mbe_degC) == pytest.approx((1.0, 1.0))
    assert sum(third.reproduced.interval_degC[98]) / 2 == pytest.approx(1.0)
    assert third.ratio == pytest.approx(math.sqrt(2))
    assert (third.samples, third.without_estimate) == (60, 0)
    assert fourth.published is fourth.ratio is None


@pytest.mark.parametrize("wild", [np.nan, np.inf, 1e200])
def test_what_is_not_finite_is_no_figure(wild):
    method = Method("a", "as_printed", lambda trace: np.full(len(trace.time_s), wild), "wild")
    (row,) = evaluate([method], {"4": run_of("4")}, {("4", "a"): published_as(1.0)}, quiet).rows
    assert row.reproduced is row.ratio is None


def test_samples_without_an_estimate_are_counted_and_not_scored():
    late = Method("a", "corrected", lambda trace: np.where(trace.time_s < 10, np.nan, 19.0), "late")
    (row,) = evaluate([late], {"4": run_of("4")}, {}, quiet).rows
    assert (row.samples, row.without_estimate) == (50, 10)
    assert row.reproduced.mbe_degC == pytest.approx(1.0)


def test_the_correlation_takes_the_variant_that_saw_the_reference_for_one_model(done):
    compared = like_published(done.evaluated.rows)
    assert len(compared) == 60
    assert {(row.model == NONCAUSAL, row.variant) for row in compared} == {(True, "noncausal"), (False, "corrected")}
    # ten ranks of six each: all in order, but the third, which was moved to the front
    assert spearman(compared) == pytest.approx(1 - 6 * 6 * (1 + 1 + 4) * 36 / (60 * (60**2 - 1)), abs=0.01)
    assert spearman(compared[:2]) is spearman([]) is None


def test_json_holds_every_method_in_eight_scenarios(done):
    erratum = Erratum(1, "a title", "a statement", (Figure("what", 1.5, "degC"),))
    data = json.loads(json.dumps(as_json(done, [erratum]), allow_nan=False))
    corrected = [(row["scenario"], row["model"]) for row in data["rows"] if row["variant"] == "corrected"]
    assert len(corrected) == len(set(corrected)) == 14 * 8
    for row in data["rows"]:
        assert row["reproduced"].keys() == {"rmse_degC", "mae_degC", "mbe_degC", "interval_degC"}
        assert row["reproduced"]["interval_degC"].keys() == {"50", "90", "98"}
        assert (row["published"] is not None) == (row["scenario"] in TABLES and row["model"] in MODELS)
    assert (data["simulated"], data["seed"], data["spearman"]) == (True, 3, done.verdict.spearman)
    figure = {"what": "what", "value": 1.5, "unit": "degC"}
    assert data["errata"] == [{"number": 1, "title": "a title", "statement": "a statement", "figures": [figure]}]


def test_no_two_runs_share_their_weather(monkeypatch):
    asked = []

    def simulate_many(wanted, progress):
        asked.extend(wanted)
        return [SimpleNamespace(trace=run) for run in wanted]

    monkeypatch.setattr(reproduction, "simulate_many", simulate_many)
    for seed in (0, 1, 2):
        found = simulated_runs(seed, quiet)
    assert len({seed for _, seed in asked}) == len(asked) == 30
    assert (found.training[0], found.idle[0]) == ("5", "1")
    assert found.idle != found.evaluated["1"]
    assert [name for name, _ in found.evaluated.values()] == list(EVALUATED)


def test_published_and_simulated_stand_side_by_side_in_the_thesis_s_order(done):
    pairs = scenario_tables(done.evaluated.rows)
    assert [pair.scenario for pair in pairs] == ["4", "1", "2.1", "3", "2.3", "2.4", "2.2", "2.5"]
    captions = [table.caption for pair in pairs[:6] for table in (pair.errors, pair.intervals)]
    assert [caption.split(":")[0] for caption in captions] == [f"Table 5.{number}" for number in range(1, 13)]
    rows = {row[0]: row[1:] for row in pairs[0].errors.rows}
    # the tenth model errs by 1 degC in half of the samples
    assert rows["Linear combined"] == ("1.00", "0.71", "0.80", "0.50", "0.10", "0.50")
    assert rows["Li et al. 2020, fixed point"][::2] == ("-", "-", "-")
    assert rows["Model 1 state-space single input, causal"][:2] == ("0.30", "0.21")
    assert rows["Model 1 state-space single input, non-causal"][:2] == ("0.30", "0.04")
    assert list(rows)[-2:] == ["Ours: circuit observer", "Ours: free observer"]
    at = next(index for index, row in enumerate(pairs[0].intervals.rows) if row[0] == "Linear combined")
    published, simulated = pairs[0].intervals.rows[at : at + 2]
    assert published == ("Linear combined", "published", "-1.00 to 1.00", "-1.00 to 1.00", "-1.00 to 1.00")
    assert simulated[1:4:2] == ("simulated", "-0.33 to 1.33")
    # a scenario that the thesis gives no figures of
    assert pairs[6].errors.columns == ("model", "RMSE sim.", "MAE sim.", "MBE sim.")
    assert {row[1] for row in pairs[6].intervals.rows} == {"simulated"}


def test_the_overview_has_a_row_a_variant_and_a_column_a_scenario(done):
    table = overview_table(done.evaluated.rows)
    assert table.columns == ("method", "variant", "1", "2.1", "2.2", "2.3", "2.4", "2.5", "3", "4")
    assert len(table.rows) == 17
    assert ("Model 1 state-space single input", "non-causal", *["0.04"] * 8) in table.rows


def test_the_verdict_names_what_differs(done):
    rows = list(done.evaluated.rows)
    before = verdict(rows)
    assert before.compared == 60
    index = next(k for k, row in enumerate(rows) if (row.scenario, row.model) == ("4", "linear_usb"))
    rows[index] = replace(rows[index], published=published_as(30.0))
    worse = verdict(rows)
    assert worse.within_factor_two == before.within_factor_two - 1
    (stray,) = set(worse.shortfalls) - set(before.shortfalls) - {worse.shortfalls[0]}
    assert all(each in stray for each in ("Scenario 4", "Linear USB", "0.57", "30.00"))
    rows[index] = replace(rows[index], reproduced=None)
    assert any("Linear USB: no finite figure" in each for each in verdict(rows).shortfalls)


def test_a_bad_correlation_is_not_hidden(done):
    rows = [
        row if row.published is None else replace(row, published=published_as(1 / row.published.rmse_degC))
        for row in done.evaluated.rows
    ]
    found = verdict(rows)
    assert found.spearman < 0
    assert f"{found.spearman:.2f}" in found.shortfalls[0]


def test_the_report_says_on_a_terminal_what_differs_and_holds_every_table_and_figure(done):
    report = report_of(done, text_errata(), [])
    console = Console(record=True, width=200, file=io.StringIO())
    print_report(console, report)
    shown = console.export_text()
    for line in done.verdict.shortfalls:
        assert line in shown
    for number in range(1, 13):
        assert f"Table 5.{number}: " in shown
    figures = next(each for each in report.sections if each.title == "The thesis's figures")
    assert [each.title.split()[1] for each in figures.blocks] == ["4.1:", "4.5:", *(f"5.{k}:" for k in range(1, 10))]
    assert report.data["headline"] == done.verdict.headline
