"""Scores of records whose figures are known by hand, and the report of them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.mitigation.report import report_of, score_table, verdict
from ambient_studies.mitigation.score import scores
from ambient_studies.mitigation.setting import Knowledge
from ambient_trainer.report import Facts

from .sample_report import SETTING, STANDBY_W, comparison, record_of, runs


def test_the_scores_of_records_known_by_hand():
    by_knowledge = {each.knowledge: each for each in scores(runs(), SETTING)}
    usual = by_knowledge[Knowledge.USUAL]
    assert usual.max_skin_degC == usual.p95_skin_degC == 42.0
    assert usual.above_limit_min == pytest.approx(2.0)
    assert usual.soc_W == pytest.approx(STANDBY_W + 3)
    assert usual.work_frac == pytest.approx(0.75)
    assert usual.estimate_rmse_degC is usual.trusted_frac is None
    assert by_knowledge[Knowledge.NOTHING].work_frac == 1.0
    assert by_knowledge[Knowledge.ESTIMATE].estimate_rmse_degC == pytest.approx(0.5)
    assert by_knowledge[Knowledge.ESTIMATE].trusted_frac == 1.0


def test_of_several_seeds_the_hottest_and_the_mean_of_all_else():
    second = [
        replace(record, case=replace(record.case, seed=2), skin_degC=record.skin_degC + 1, soc_W=record.soc_W * 2)
        for record in runs()
    ]
    usual = next(each for each in scores([*runs(), *second], SETTING) if each.knowledge is Knowledge.USUAL)
    assert usual.max_skin_degC == 43.0
    assert usual.p95_skin_degC == pytest.approx(42.5)
    assert usual.soc_W == pytest.approx(1.5 * (STANDBY_W + 3))
    shares = [3 / 4, (2 * (STANDBY_W + 3) - STANDBY_W) / (2 * (STANDBY_W + 4) - STANDBY_W)]
    assert usual.work_frac == pytest.approx(np.mean(shares))


def test_table_and_data_hold_the_scores():
    rows = score_table(scores(runs(), SETTING), SETTING).rows
    assert rows[2] == ("20", "assumes 20 degC", "42.0", "42.0", "2.0", f"{STANDBY_W + 3:.2f}", "75 %", "-")
    assert rows[3][-2:] == ("50 %", "0.50")
    data = json.loads(json.dumps(report_of(comparison()).data))
    assert data["seeds"] == [1]
    assert data["governor"]["rest_gains"] == pytest.approx({"soc": 0.25, "ambient": 0.75})
    assert [each["told"] for each in data["rows"]] == ["NOTHING", "HOTTEST", "USUAL", "ESTIMATE", "TRUTH"]
    assert data["rows"][2]["work_frac"] == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("changes", "facts", "absent"),
    [
        ({}, ["50 %", "25 %", "for 2.0 of 10 min", "42.0 degC"], ["nothing", "costs", "trusted"]),
        ({"HOTTEST": record_of(Knowledge.HOTTEST, 2.0, 39.0)}, ["50 %", "worth nothing"], ["costs"]),
        ({"HOTTEST": record_of(Knowledge.HOTTEST, 2.4, 39.0)}, ["50 %", "60 %", "costs work"], ["nothing"]),
        ({"HOTTEST": record_of(Knowledge.HOTTEST, 2.4, 41.0)}, ["60 %", "2.0 of 10 min", "41.0 degC"], ["costs"]),
        (
            {"ESTIMATE": record_of(Knowledge.ESTIMATE, 2.0, 40.5, error_degC=0.5)},
            ["2.0 of 10 min", "40.5 degC", "truth for 0.0 min"],
            ["42.0 degC"],
        ),
        (
            {"ESTIMATE": record_of(Knowledge.ESTIMATE, 2.0, 39.0, error_degC=0.5, trusted_until_s=150.0)},
            ["trusted 25 %", "35 degC"],
            ["nothing"],
        ),
    ],
)
def test_the_verdict_names_gain_excess_and_trust(changes, facts, absent):
    [sentence] = verdict(scores(runs(**changes), SETTING), SETTING)
    assert sentence.startswith("20 degC:")
    assert all(each in sentence for each in facts)
    assert not any(each in sentence for each in absent)


def test_a_change_of_air_stands_among_the_facts():
    [facts] = [each for each in report_of(comparison(convection_W_m2_K125=2.8)).lead if isinstance(each, Facts)]
    assert "2.8" in dict(facts.pairs)["air"]
