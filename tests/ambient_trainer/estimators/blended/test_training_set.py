"""What is made up: ambient and work like the log's, unlogged heat of the sizes that the recipe says."""

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.estimators.blended.forward import Forward, Record
from ambient_trainer.estimators.blended.recipe import Synthetic, Unmeasured, find_recipe
from ambient_trainer.estimators.blended.training_set import (
    AmbientModel,
    TrainingSetDesign,
    fit_ambient,
    fit_workload,
    synthetic_ambient,
    synthetic_heat,
    synthetic_work,
)
from ambient_trainer.estimators.library.recipes import record_of

RULE = Synthetic.model_validate(
    {
        "ambient_degC": [-10, 50],
        "stay_min": [20, 60],
        "settling_s": 60,
        "episode_min": [5, 25],
        "busy": 0.2,
        "idle": {"runs": 2, "hours": 2},
    }
)


def test_a_swing_a_slope_and_noise_come_back():
    random = np.random.default_rng(1)
    count = 8 * 720
    time_s = 5.0 * np.arange(count)
    noise = np.zeros(count)
    for k in range(1, count):
        noise[k] = 0.9 * noise[k - 1] + 0.1 * np.sqrt(1 - 0.81) * random.standard_normal()
    steps = np.interp(time_s, [0, 7200, 8200, 28_000], [10, 10, 40, 40])
    found = fit_ambient([steps + 0.8 * np.sin(2 * np.pi * time_s / 900) + noise], 5.0, "log")
    assert found.swing_K == pytest.approx(0.8, rel=0.05)
    assert found.swing_period_s == pytest.approx(900, rel=0.02)
    assert found.noise_K == pytest.approx(0.1, rel=0.2)
    assert found.noise_memory == pytest.approx(0.9, abs=0.05)
    assert found.slope_K_s == pytest.approx(0.03 + 0.8 * 2 * np.pi / 900, rel=0.1)


def test_a_log_without_an_hour_is_refused():
    with pytest.raises(Refused, match=r"^log"):
        fit_ambient([np.zeros(500), np.ones(700)], 5.0, "log")


def test_a_synthetic_ambient_goes_through_its_set_points_no_faster_than_it_may():
    still = AmbientModel(slope_K_s=0.05, swing_K=0.0, swing_period_s=900, noise_K=0.0, noise_memory=0.5, period_s=5.0)
    made = synthetic_ambient(still, RULE, 20_000, np.random.default_rng(2))
    assert np.abs(np.diff(made)).max() <= 0.05 * 5 * 1.0001
    assert -10 <= made.min() < 0 < 40 < made.max() <= 50


def record(load: list[float]) -> Record:
    work = np.array(load)
    return Record(np.zeros((1, len(work))), np.zeros(len(work)), 0.2 + work, 0.1 + 0.5 * work, work)


def test_work_is_found_and_played_again():
    rule = find_recipe("phone_observer")[0].work
    workload = fit_workload([record([0.0] * 50 + [0.5] * 20 + [1.0] * 30 + [0.0] * 10 + [1.0] * 5)], rule, "log")
    assert workload.idle_W == pytest.approx([0.2, 0.1])
    assert [each.shape[1] for each in workload.episodes_W] == [20, 30, 5]
    made = synthetic_work(workload, RULE, 200_000, 5.0, np.random.default_rng(3))
    busy = made[0] > 0.2 + 1e-9
    assert busy.mean() == pytest.approx(0.2, rel=0.15)
    assert made[0].max() == pytest.approx(1.2)
    # what is shared goes along with what is measured
    assert made[1] - 0.1 == pytest.approx(0.5 * (made[0] - 0.2))


@pytest.mark.parametrize(("load", "how"), [([0.0] * 10, "never"), ([1.0] * 10, "always")])
def test_a_log_without_work_or_without_pauses_is_refused(load, how):
    rule = find_recipe("phone_observer")[0].work
    with pytest.raises(Refused, match=f"column cpu_load_frac: is {how} above 0.1"):
        fit_workload([record(load)], rule, "log")


def test_unmeasured_heat_has_the_mean_that_is_declared():
    rule = Unmeasured(runs=1, hours=1, episode_min=(2, 27), pause_min=(5, 25), log_deviation=0.4, patterns={})
    random = np.random.default_rng(4)
    made = synthetic_heat({"b": 0.5, "c": 2.0}, rule, {"a": 0, "b": 1, "c": 2}, 1_000_000, 5.0, random)
    on = made[1] > 0
    assert not made[0].any()
    assert (on == (made[2] > 0)).all()
    assert made[1][on].mean() == pytest.approx(0.5, rel=0.1)
    assert made[2][on].mean() == pytest.approx(2.0, rel=0.1)
    assert on.mean() == pytest.approx(27 / (27 + 25), rel=0.1)


@pytest.fixture
def design(observer_file, brick_log):
    recipe, circuit = find_recipe(observer_file)
    log = [record_of(recipe, brick_log.columns)]
    fit = Forward(recipe, circuit).fit(log, 5.0, lambda *_: None)
    ambient = fit_ambient([log[0].ambient_degC], 5.0, "log")
    workload, steps = fit_workload(log, recipe.work, "log"), (0.0, 0.5, 0.0)
    return TrainingSetDesign(recipe, fit.plant, ambient, workload, 5.0, 1, 0, steps), log


def test_the_training_set_is_that_of_the_recipe(design):
    made, log = design
    runs = made.runs(log)
    assert {name: len(each) for name, each in runs.items()} == {
        "logged": 1,
        "idle": 2,
        "residual": 1,
        "charge": 4,
        "screen": 2,
    }
    [rest] = runs["residual"]
    assert not rest.outputs.any()
    assert np.sqrt(np.mean(rest.inputs**2)) < 0.03
    for each in runs["idle"]:
        # a device that idles lies near its ambient
        assert 0 < np.median(each.inputs - each.outputs) < 4
        assert set(np.unique(each.inputs[1] % 0.5)) == {0.0}, "the log's resolution"


def test_the_same_seed_makes_up_the_same_with_samples_in_between_for_a_finer_filter(design):
    made, log = design
    first, again = made.runs(log), made.runs(log)
    other = TrainingSetDesign(**{**vars(made), "seed": 1}).runs(log)
    assert np.array_equal(first["charge"][0].inputs, again["charge"][0].inputs)
    assert not np.array_equal(first["charge"][0].inputs, other["charge"][0].inputs)
    fine = [Record(*(np.repeat(each, 5, axis=-1) for each in log[0]))]
    finer = TrainingSetDesign(**{**vars(made), "period_s": 1.0, "coarser": 5}).runs(fine)
    for name, several in made.runs(log).items():
        for coarse, each in zip(several, finer[name]):
            assert each.inputs[:, ::5] == pytest.approx(coarse.inputs)
            assert each.outputs.shape[1] == 5 * coarse.outputs.shape[1]
