"""The forward simulation against an integrator; a device's constants and its ambient's come back from its log."""

import numpy as np
import pytest

from ambient_trainer.estimators.blended.forward import Forward
from ambient_trainer.estimators.blended.recipe import find_recipe
from ambient_trainer.estimators.blended.training_set import fit_ambient
from ambient_trainer.estimators.library.recipes import record_of

from .conftest import TRUTH


@pytest.fixture
def forward(observer_file):
    recipe, circuit = find_recipe(observer_file)
    return Forward(recipe, circuit)


@pytest.fixture
def record(forward, brick_log):
    return record_of(forward.recipe, brick_log.columns)


def truly(forward, truth):
    """The search's unknowns of the true constants."""
    positive = [np.log(value) for name, value in truth.items() if name not in ("share_board", "rho")]
    return np.array([*positive, truth["share_board"], np.log(truth["rho"] / (1 - truth["rho"]))])


def test_with_the_true_constants_only_noise_is_left_and_few_passes_are_near(forward, record):
    x = truly(forward, TRUTH)
    assert forward.values(x) == pytest.approx(TRUTH)
    [misfit] = forward.plant(x).misfits([record], 5.0)
    # between samples 5 s apart the nodes bend a little
    assert (np.sqrt(np.mean(misfit**2, axis=1)) < 0.025).all()
    plant = forward.plant(truly(forward, TRUTH))
    heat = plant.heat_W(record.measured_W, record.shared_W)
    four, ten, twenty = (plant.readings_degC(record.ambient_degC, heat, 5.0, passes) for passes in (4, 10, 20))
    assert np.abs(ten - twenty).max() < 1e-4
    assert np.abs(four - twenty).max() < 0.1


def test_a_brick_s_constants_come_back_from_its_log(forward, record):
    heard = []
    found = forward.fit([record], 5.0, lambda evaluation, square: heard.append((evaluation, square)))
    assert found.converged
    assert found.values == pytest.approx(TRUTH, rel=0.05)
    assert max(found.misfit_degC.values()) < 0.025
    assert [count for count, _ in heard] == list(range(1, found.evaluations + 1))


def test_what_is_believed_holds_where_the_log_says_nothing(observer_file, brick_log):
    recipe, circuit = find_recipe(observer_file)
    stubborn = recipe.model_copy(update={"prior": recipe.prior.model_copy(update={"capacitance": 1e-4})})
    found = Forward(stubborn, circuit).fit([record_of(stubborn, brick_log.columns)], 5.0, lambda *_: None)
    first = {name: found.values[name] for name in ("C_chip", "C_board", "C_shell")}
    assert first == pytest.approx({"C_chip": 3, "C_board": 15, "C_shell": 40}, rel=0.01)


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
