"""A simulated run: the thesis's durations, magnitudes near its own, and the same bytes from the same seed."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.simulation import constants as c
from ambient_trainer.simulation.chamber import ramped, wobble
from ambient_trainer.simulation.instruments import probe_reading, sensor_reading
from ambient_trainer.simulation.phone import schedule, simulate
from ambient_trainer.simulation.scenario import Scenario, load_scenario, scenario_names
from ambient_trainer.strict_yaml import validated
from ambient_trainer.traces.trace import load_trace, save_trace

_THESIS = Path(__file__).parents[4] / "shared" / "thesis"

_STATED_MIN = {  # section 3.2, added up
    "1": 30,
    "2.1": 10,
    "2.2": 50,
    "2.3": 10 + 10 + 10,
    "2.4": 20,
    "2.5": 15,
    "3": 80,
    "4": 35 + 25 + 60 + 20 + 150 + 20 + 25 + 60 + 15 + 20 + 50 + 20 + 75,
    "5": 20 + 10 + 35 + 10 + 75 + 10 + 15 + 30 + 10 + 10 + 30 + 10 + 35 + 10 + 15 + 10 + 10 + 15 + 10 + 15,
}


def test_the_scenarios_are_the_thesiss_and_last_as_long():
    assert scenario_names() == tuple(_STATED_MIN)
    assert {name: load_scenario(name).duration_s / 60 for name in scenario_names()} == _STATED_MIN


def test_scenario_5_goes_through_the_stated_ambients_and_loads():
    steps = load_scenario("5").steps
    assert list(dict.fromkeys(step.chamber_degC for step in steps)) == [-10, 10, 30, 50, 20]
    minutes = {name: sum(s.duration_min for s in steps if s.activity == name) for name in {s.activity for s in steps}}
    assert minutes == {"idle": 285, "cpu_100": 40, "cpu_50": 20, "camera_1080p": 20, "camera_4k": 20}


def test_an_unknown_scenario_is_refused_with_the_names():
    with pytest.raises(Refused, match=r"none is called '6'; take one of 1, 2\.1, .*, 4, 5$"):
        simulate("6")


def test_a_faulty_scenario_is_refused_whole():
    data = {"about": "x", "steps": [{"duration_min": 0, "chamber_degC": 20, "activity": "flying", "fan": 1}]}
    with pytest.raises(Refused) as refused:
        validated(Scenario, data, "mine.yaml")
    assert [fault.place for fault in refused.value.faults] == [
        "steps[0].duration_min",
        "steps[0].activity",
        "steps[0].fan",
    ]
    assert refused.value.faults[2].mend == (
        "remove it or correct its name; known are duration_min, chamber_degC, activity"
    )


def test_the_trace_keeps_to_the_contract(tmp_path):
    trace = simulate("2.1", seed=3)
    assert list(trace.columns) == [
        *("soc_degC", "flash_degC", "battery_degC", "usb_degC", "display_degC", "ambient_degC"),
        *("soc_power_W", "charging_on", "cpu_load_frac", "battery_current_A"),
    ]
    assert trace.time_s.tolist() == list(range(600))
    path = str(tmp_path / "t.csv")
    save_trace(path, trace)
    read = load_trace(path)
    assert read.notes == {"simulated": "yes", "scenario": "2.1", "seed": "3"}
    assert all(np.array_equal(read.columns[name], trace.columns[name]) for name in trace.columns)
    for sensor in c.SENSORS:
        tenths = 10 * trace.columns[f"{sensor}_degC"]
        assert tenths == pytest.approx(np.round(tenths), abs=1e-9)


def test_a_seed_gives_its_own_bytes_again(tmp_path):
    def written(name, seed):
        save_trace(str(tmp_path / name), simulate("2.1", seed=seed))
        return (tmp_path / name).read_bytes()

    assert written("a", 1) == written("b", 1)
    assert written("a", 1) != written("c", 2)


def test_a_period_that_divides_nothing_covers_the_scenario():
    trace = simulate("2.5", period_s=7.0)
    assert len(trace.time_s) == 129  # 900 s / 7 s, rounded up
    assert trace.time_s[-1] == 896.0
    assert np.unique(np.diff(trace.time_s)).tolist() == [7.0]


def test_a_step_takes_effect_at_its_first_sample():
    _, loads = schedule(load_scenario("2.5"), np.arange(900.0))
    assert [load.cpu_load_frac for load in loads] == [1.0] * 600 + [0.02] * 300


def test_progress_is_told():
    told = []
    simulate("2.5", progress=lambda done, total: told.append((done, total)))
    assert told == [(500, 900)]


def _published():
    if not _THESIS.is_dir():
        pytest.skip(f"the thesis's statistics are not at {_THESIS}")
    with (_THESIS / "sensor_statistics.csv").open() as stream:
        rows = [(row["scenario"], row["sensor"], float(row["mean_degC"])) for row in csv.DictReader(stream)]
    with (_THESIS / "display_mean.csv").open() as stream:
        return rows + [(row["scenario"], "display", float(row["mean_degC"])) for row in csv.DictReader(stream)]


def test_means_come_near_the_thesiss():
    traces = {name: simulate(name, period_s=2.0) for name in ("1", "2.1", "2.3", "2.4")}
    for scenario, sensor, mean_degC in _published():
        ours = traces[scenario].column(f"{sensor}_degC").mean()
        assert ours == pytest.approx(mean_degC, abs=1.6), (scenario, sensor)


def test_the_die_reaches_about_90_degrees_at_full_load_whatever_the_ambient():
    trace = simulate("4", period_s=5.0)
    soc_degC = trace.column("soc_degC")
    full = trace.column("cpu_load_frac") == 1.0
    for ambient_degC in (-10, 30, 50):
        at = full & (np.abs(trace.reference - ambient_degC) < 3)
        assert 86 < soc_degC[at].max() < 93
    assert soc_degC.max() < 93
    assert trace.column("soc_power_W").min() > 0.0


def test_the_chamber_ramps_at_its_rate_and_starts_settled():
    set_point = np.array([20.0] * 3 + [26.0] * 200)
    air = ramped(set_point, 1.0)
    assert air[:4].tolist() == [20.0] * 4
    assert np.diff(air).max() == pytest.approx(0.05)
    assert air[-1] == 26.0
    assert np.argmax(air == 26.0) == pytest.approx(3 + 120, abs=1)


@pytest.mark.parametrize("period_s", [1.0, 10.0])
def test_the_wobbles_statistics_do_not_depend_on_the_period(period_s):
    noise = wobble(400_000, period_s, np.random.default_rng(5))
    assert noise.std() == pytest.approx(0.4, rel=0.1)
    lag = round(240 / period_s)
    assert np.corrcoef(noise[:-lag], noise[lag:])[0, 1] == pytest.approx(np.exp(-1), abs=0.06)


def test_the_first_wobble_is_as_large_as_the_later_ones():
    first = [wobble(1, 1.0, np.random.default_rng(seed))[0] for seed in range(2000)]
    assert np.std(first) == pytest.approx(0.4, rel=0.06)


def test_instruments_round_and_err_as_stated():
    random = np.random.default_rng(7)
    flat = np.full(20_000, 21.234)
    reading = sensor_reading(flat, random)
    assert sorted(set(reading.tolist())) == [21.1, 21.2, 21.3, 21.4]
    assert reading.mean() == pytest.approx(21.234, abs=0.01)
    errors = [probe_reading(flat[:50], random).mean() - 21.234 for _ in range(1000)]
    assert np.std(errors) == pytest.approx(0.1 / np.sqrt(4), rel=0.1)
