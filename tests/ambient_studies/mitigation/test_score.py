"""Scores of runs whose figures can be told by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.mitigation.loop import Record
from ambient_studies.mitigation.room import Room
from ambient_studies.mitigation.score import score_table, scores, verdict
from ambient_studies.mitigation.setting import Case, Setting, Told
from ambient_trainer.simulator.device_file import load_device

SETTING = Setting(work_min=10.0, idle_min=5.0)
STANDBY_W = load_device().activities["idle"].heat_W["soc"]


def record_of(told, watts, skin_degC, seed=1, error_degC=None, trusted_until_s=600.0):
    """Ten minutes after five of idle; ``skin_degC`` in the last two of them, 30 before; the idle time is on fire."""
    time_s = np.arange(-300.0, 600.0)
    skin = np.where(time_s < 0, 99.0, np.where(time_s < 480, 30.0, skin_degC))
    power_W = np.where(time_s < 0, 50.0, STANDBY_W + watts)
    air = np.full(900, 20.0)
    estimate = np.full(900, np.nan) if error_degC is None else air + error_degC
    trusted = np.full(900, error_degC is not None) & (time_s < trusted_until_s)
    return Record(Case(Room((20.0,)), seed, told), time_s, air, skin, power_W, air, estimate, trusted)


def runs(**changes):
    shown = {
        "NOTHING": record_of(Told.NOTHING, 4.0, 45.0),
        "HOTTEST": record_of(Told.HOTTEST, 1.0, 38.0),
        "USUAL": record_of(Told.USUAL, 3.0, 42.0),
        "ESTIMATE": record_of(Told.ESTIMATE, 2.0, 39.0, error_degC=0.5),
        "TRUTH": record_of(Told.TRUTH, 2.0, 39.5),
        **changes,
    }
    return list(shown.values())


def test_a_score_is_what_the_run_was():
    by_told = {each.told: each for each in scores(runs(), SETTING)}
    usual = by_told["USUAL"]
    assert usual.max_skin_degC == usual.p95_skin_degC == 42.0
    assert usual.above_limit_min == pytest.approx(2.0)
    assert usual.soc_W == pytest.approx(STANDBY_W + 3)
    assert usual.work_frac == pytest.approx(0.75)
    assert usual.estimate_rmse_degC is usual.trusted_frac is None
    assert by_told["NOTHING"].work_frac == 1.0
    assert by_told["ESTIMATE"].estimate_rmse_degC == pytest.approx(0.5)
    assert by_told["ESTIMATE"].trusted_frac == 1.0


def test_several_seeds_show_the_hottest_and_the_mean_of_all_else():
    second = [
        replace(record, case=replace(record.case, seed=2), skin_degC=record.skin_degC + 1, soc_W=record.soc_W * 2)
        for record in runs()
    ]
    usual = next(each for each in scores([*runs(), *second], SETTING) if each.told == "USUAL")
    assert usual.max_skin_degC == 43.0
    assert usual.p95_skin_degC == pytest.approx(42.5)
    assert usual.soc_W == pytest.approx(1.5 * (STANDBY_W + 3))
    shares = [3 / 4, (2 * (STANDBY_W + 3) - STANDBY_W) / (2 * (STANDBY_W + 4) - STANDBY_W)]
    assert usual.work_frac == pytest.approx(np.mean(shares))


def test_the_table_shows_it():
    table = score_table(scores(runs(), SETTING), SETTING)
    assert [row[1] for row in table.rows] == [
        "none",
        "assumes 35 degC",
        "assumes 20 degC",
        "has the estimate",
        "knows the truth",
    ]
    assert table.rows[2] == ("20", "assumes 20 degC", "42.0", "42.0", "2.0", f"{STANDBY_W + 3:.2f}", "75 %", "-")
    assert table.rows[3][-2:] == ("50 %", "0.50")
    assert "Simulated." in table.caption
    assert "minutes above 40 degC" in table.caption


GAIN = "20 degC: 50 % of the work with the estimate, 25 % where 35 degC is assumed"
USUAL = " Where 20 degC is assumed, the skin is above 40 degC for 2.0 of 10 min, up to 42.0 degC."


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, f"{GAIN}.{USUAL}"),
        (
            {"HOTTEST": record_of(Told.HOTTEST, 2.0, 39.0)},
            "20 degC: 50 % of the work with the estimate, 50 % where 35 degC is assumed; here the estimate is worth "
            f"nothing.{USUAL}",
        ),
        (
            {"HOTTEST": record_of(Told.HOTTEST, 2.4, 39.0)},
            "20 degC: 50 % of the work with the estimate, 60 % where 35 degC is assumed; here its error costs work."
            f"{USUAL}",
        ),
        (
            {"HOTTEST": record_of(Told.HOTTEST, 2.4, 41.0)},
            "20 degC: 50 % of the work with the estimate, 60 % where 35 degC is assumed and the skin is above 40 degC "
            f"for 2.0 of 10 min, up to 41.0 degC.{USUAL}",
        ),
        (
            {"ESTIMATE": record_of(Told.ESTIMATE, 2.0, 40.5, error_degC=0.5)},
            f"{GAIN}. With the estimate the skin is above 40 degC for 2.0 of 10 min, up to 40.5 degC, with the truth "
            "for 0.0 min.",
        ),
        (
            {"ESTIMATE": record_of(Told.ESTIMATE, 2.0, 39.0, error_degC=0.5, trusted_until_s=150.0)},
            f"{GAIN}.{USUAL} The estimate was trusted 25 % of the time; else 35 degC was assumed.",
        ),
    ],
)
def test_the_verdict_says_what_it_is_worth_and_where_it_is_not(changes, sentence):
    assert verdict(scores(runs(**changes), SETTING), SETTING) == [sentence]
