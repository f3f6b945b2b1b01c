"""Rooms, the governor's training on a phone of known constants, and scores of records that are known by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_studies.mitigation.comparison import identify, scores
from ambient_studies.mitigation.setting import Knowledge, Room, room_of
from ambient_trainer.data.trace import Trace

from .sample_report import SETTING, STANDBY_W, constant_model, runs


@pytest.mark.parametrize("study", ["mitigate", "limit", "units"])
def test_a_model_of_another_device_is_refused_before_anything_is_simulated(trainer, saved, monkeypatch, study):
    monkeypatch.setattr("ambient_studies.lower_bound.study.simulate_many", None)
    status, _, err = trainer(study, saved(constant_model(20.0, "ch102")))
    assert (status, "reads ch102_degC" in err) == (1, True)
    assert study != "limit" or "reads ch102_degC, which the simulated phone does not log" in err


@pytest.mark.parametrize(("text", "temps"), [("5", (5.0,)), ("-3.5", (-3.5,)), ("35/5/35", (35.0, 5.0, 35.0))])
def test_a_room_is_read_and_named_as_it_is_written(text, temps):
    assert room_of(text) == Room(temps)
    assert room_of(text).name == text


def test_each_room_has_its_part_and_the_first_the_time_before():
    air = Room((35.0, 5.0, 20.0)).air_degC(600, 600 + 3 * 1200, 1.0, np.random.default_rng(1))
    for start, stop, temp in ((0, 1800, 35.0), (1900, 3000, 5.0), (3100, 4200, 20.0)):
        assert np.abs(air[start:stop] - temp).max() < 1.2
        assert air[start:stop].mean() == pytest.approx(temp, abs=0.2)
    # through the door: 63 % of the way in 20 s
    assert air[1820] == pytest.approx(35 - 30 * (1 - np.exp(-1)), abs=1.5)


def known_phone(noise_degC):
    """A skin of first order: 2.5 K per W, 240 s; the sensor stands 10 K per W above it at once."""
    random = np.random.default_rng(3)
    count = 12_000
    air = 20 + 15 * np.repeat(random.uniform(-1, 1, 12), 1000)
    power_W = np.repeat(random.uniform(0, 4, 40), 300)
    power_W[:300] = 0.0  # it starts in steady state
    kept = np.exp(-1 / 240)
    # held from sample to sample, as the simulation holds it
    heated, walls_K = lfilter([0, 1 - kept], [1, -kept], np.vstack([2.5 * power_W, air - air[0]]))
    skin = air[0] + walls_K + heated
    columns = {
        "soc_degC": skin + 10 * power_W,
        "air_degC": air,
        "soc_power_W": power_W,
        "ambient_degC": skin + random.normal(0, noise_degC, count),
    }
    return Trace("known", np.arange(count, dtype=float), columns)


def test_a_known_phone_is_recovered_and_the_margin_is_what_the_skin_was_hotter_than_predicted():
    fitted, noisy = identify(known_phone(0.01)), identify(known_phone(0.5))
    assert fitted.sensor == "soc"
    assert fitted.resistance_K_W == pytest.approx(2.5, rel=0.01)
    assert fitted.time_constant_s == pytest.approx(240, rel=0.01)
    # in steady state: skin = air + 2.5 P and sensor = air + 12.5 P
    assert fitted.dc_gains == pytest.approx((0.2, 0.8), abs=0.01)
    # 95 % of a normal error lie below 1.645 standard deviations
    assert noisy.margin_K == pytest.approx(1.645 * 0.5, abs=0.05)
    assert 0 <= fitted.margin_K < 0.05


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
