"""The filter against a recursion written out, its noise gain against noise, its Gram matrices against sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.estimators.blended.filters import TrainedFilter
from ambient_trainer.estimators.blended.poles import (
    Objective,
    best_weights,
    dc_gains,
    denominators,
    first_unknowns,
    noise_gram,
    run_gram,
    search_poles,
    section_poles,
    signals,
)
from ambient_trainer.estimators.blended.recipe import FilterRules
from ambient_trainer.estimators.blended.training_set import TrainingRun
from ambient_trainer.lti.response import response_degC

RULES = FilterRules.model_validate(
    {
        "noise": 1e-3,
        "one_degree": 100,
        "slow": {"time_constants_s": [300, 150], "slowest_s": 1500, "least_ratio": 1.5},
        "fast": {"time_s": 20, "damping": 0.8, "least_damping": 0.7},
    }
)
POLES = section_poles(np.log([1 / 400, 2.0, 1 / 18, 0.8]))
rates = st.floats(np.log(1 / 1500), np.log(1 / 20))


def recursed(poles: np.ndarray, period_s: float, u: np.ndarray) -> np.ndarray:
    """The five signals of one input (N,), one sample after the other, from equilibrium."""
    states = [[u[0], u[0]] for _ in range(2)]
    rows = []
    for value in u:
        row = [value]
        for section, (_, a1, a2) in enumerate(denominators(poles, period_s)):
            g = 1 + a1 + a2
            last, before = states[section]
            row += [last, (last - before) / np.sqrt(g)]
            states[section] = [g * value - a1 * last - a2 * before, last]
        rows.append(row)
    return np.array(rows).T


def walk(seed: int, inputs: int, count: int) -> np.ndarray:
    return 20 + np.cumsum(np.random.default_rng(seed).standard_normal((inputs, count)), axis=1)


def test_the_signals_are_those_of_the_recursion():
    u = walk(1, 2, 300)
    found = signals(POLES, 1.0, u).reshape(5, 2, -1)
    for index in range(2):
        assert found[:, index] == pytest.approx(recursed(POLES, 1.0, u[index]), abs=1e-9)


@given(rates, st.floats(np.log(1.05), 2.0), st.floats(np.log(1 / 60), np.log(1 / 5)), st.floats(-0.3, 1.0))
def test_the_denominators_have_the_poles_that_are_asked_for(log_rate, log_ratio, log_omega, log_zeta):
    rate, ratio, omega, zeta = np.exp([log_rate, log_ratio, log_omega, log_zeta])
    slow, fast = denominators(section_poles(np.array([log_rate, log_ratio, log_omega, log_zeta])), 2.0)
    assert np.sort(np.roots(slow).real) == pytest.approx(np.sort(np.exp([-2 * rate * ratio, -2 * rate])), rel=1e-6)
    continuous = np.roots([1, 2 * zeta * omega, omega**2])
    assert np.polyval(fast, np.exp(2 * continuous)) == pytest.approx([0, 0], abs=1e-9)


def test_the_noise_gram_is_the_energy_of_the_impulse_response():
    impulse = np.zeros((1, 20_000))
    impulse[0, 1] = 1.0
    response = signals(POLES, 1.0, impulse)
    assert noise_gram(POLES, 1.0, 1) == pytest.approx(response @ response.T, rel=1e-6, abs=1e-9)


def run(seed: int, absolute: bool = True, target: np.ndarray | None = None) -> TrainingRun:
    u = walk(seed, 3, 2000)
    return TrainingRun(u, u.mean(axis=0) - 1 if target is None else target, 3, absolute)


@pytest.mark.parametrize("absolute", [True, False])
def test_a_run_s_gram_is_the_mean_square_of_the_error(absolute):
    given_run = run(3, absolute)
    weights = np.random.default_rng(4).standard_normal(16)
    said = weights[:-1] @ signals(POLES, 1.0, given_run.sensors_degC) + absolute * weights[-1]
    direct = np.mean((given_run.target_degC - said)[::3] ** 2)
    assert run_gram(POLES, 1.0, given_run)(weights) == pytest.approx(direct, rel=1e-9)


def test_the_objective_is_the_sum_of_what_it_says():
    runs = {"a": [run(5), run(6)], "b": [run(7, absolute=False)], "unweighed": [run(8)]}
    objective = Objective(runs, {"a": 2.0, "b": 0.5, "unweighed": 0.0}, RULES, 1.0)
    weights = np.random.default_rng(9).standard_normal(16)
    direct = 0.0
    for each, count in ((runs["a"][0], 1.0), (runs["a"][1], 1.0), (runs["b"][0], 0.5)):
        said = weights[:-1] @ signals(POLES, 1.0, each.sensors_degC) + each.absolute * weights[-1]
        direct += count * np.mean((each.target_degC - said)[::3] ** 2)
    direct += 1e-3 * weights[:-1] @ noise_gram(POLES, 1.0, 3) @ weights[:-1]
    at_rest = dc_gains(3) @ weights[:-1]
    direct += 100 * (at_rest.sum() - 1) ** 2
    gram = objective.at(POLES)
    assert gram(weights) == pytest.approx(direct, rel=1e-9)
    best = best_weights(gram)
    for step in np.eye(16) * 1e-3:
        assert gram(best + step) > gram(best)
        assert gram(best - step) > gram(best)


def trained(seed: int = 10) -> TrainedFilter:
    runs = {"logged": [run(seed)]}
    found, _ = search_poles(Objective(runs, {"logged": 1.0}, RULES, 1.0), RULES, first_unknowns(RULES), lambda *_: 0)
    return TrainedFilter(("a_degC", "b_degC", "c_degC"), 1.0, found)


def test_the_continuous_system_says_the_same():
    each = trained()
    u = walk(12, 3, 2000)
    assert response_degC(each.system(), "first-order", u, 1.0) == pytest.approx(each.estimate_degC(u), abs=1e-7)
    assert each.system().A.shape == (4, 4)
    gains = each.system().D - each.system().C @ np.linalg.solve(each.system().A, each.system().B)
    assert gains[0] == pytest.approx(list(each.dc_gains.values()), abs=1e-8)


def test_the_search_finds_the_poles_that_made_the_target():
    truth = np.log([1 / 400, 2.5, 1 / 25, 0.9])
    random = np.random.default_rng(13)
    weights = random.standard_normal(15)
    # of unit gain at rest, as the objective wants it
    weights[3:6] += (1 - (dc_gains(3) @ weights).sum()) / 3
    rules = RULES.model_copy(update={"noise": 1e-9})
    u = walk(14, 3, 20_000)
    target = weights @ signals(section_poles(truth), 1.0, u) + 0.05 * random.standard_normal(20_000)
    objective = Objective({"made": [TrainingRun(u, target, 3, True)]}, {"made": 1.0}, rules, 1.0)
    found, reached = search_poles(objective, rules, first_unknowns(rules), lambda *_: None)
    assert found.converged
    assert found.identifiable
    assert not any(found.at_bound)
    assert np.exp(reached) == pytest.approx(np.exp(truth), rel=0.05)
    assert found.objective == pytest.approx(0.05**2, rel=0.05)


def test_the_search_keeps_to_its_bounds_and_says_where_they_hold():
    each = trained().found
    omega, zeta = np.exp(each.poles).reshape(-1, 2)[0]
    root = np.sqrt(zeta**2 - 1)
    slowest, next_one = 1 / (omega * (zeta - root)), 1 / (omega * (zeta + root))
    assert slowest <= 1500 * 1.001
    assert slowest / next_one >= 1.499
    assert np.exp(each.poles[3]) >= 0.699
    assert len(each.at_bound) == 4
