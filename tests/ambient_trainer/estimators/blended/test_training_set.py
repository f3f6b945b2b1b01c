"""What is made up: ambient and work like the log's, unlogged heat of the sizes that the recipe says."""

import numpy as np
import pytest

from ambient_trainer.estimators.blended.forward import Forward, Record
from ambient_trainer.estimators.blended.recipe import find_recipe
from ambient_trainer.estimators.blended.training_set import (
    TrainingSetDesign,
    fit_ambient,
    fit_workload,
)
from ambient_trainer.estimators.library.recipes import record_of


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
