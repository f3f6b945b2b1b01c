"""Rows, correlation, verdict, tables and JSON of a reproduction whose methods have known errors."""

import math
from types import SimpleNamespace

import pytest

from ambient_studies.thesis import reproduction
from ambient_studies.thesis.published import NONCAUSAL
from ambient_studies.thesis.reproduction import EVALUATED, simulated_runs
from ambient_studies.thesis.rows import evaluate, like_published, spearman

from .sample_report import off_by, published_as, run_of, synthetic_reproduction


def quiet(what, done, total):
    assert 0 <= done < total


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


def test_the_correlation_takes_the_variant_that_saw_the_reference_for_one_model():
    compared = like_published(synthetic_reproduction().evaluated.rows)
    assert len(compared) == 60
    assert {(row.model == NONCAUSAL, row.variant) for row in compared} == {(True, "noncausal"), (False, "corrected")}
    # ten ranks of six each: all in order, but the third, which was moved to the front
    assert spearman(compared) == pytest.approx(1 - 6 * 6 * (1 + 1 + 4) * 36 / (60 * (60**2 - 1)), abs=0.01)
    assert spearman(compared[:2]) is spearman([]) is None


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
