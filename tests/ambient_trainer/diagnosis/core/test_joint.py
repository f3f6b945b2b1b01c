"""The joint fit: columns against differences of simulations, its end against another optimiser's, folds by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ambient_trainer.diagnosis import joint
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.extended import Effect, Model, view
from ambient_trainer.diagnosis.joint import FOLDS, Teaching, blocks, bounded, changed, fitted
from ambient_trainer.diagnosis.noise import ORDER
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.diagnosis.teach import searched
from ambient_trainer.diagnosis.terms import beginning, ending

N = 360
START = np.array([30.0, 26.0, 22.0])


def _record(chain, seed: int = 1, heat=None, noise: float = 0.05, **changed_values: float):
    inputs = chain.inputs(N, seed)
    nodes = chain.integrated(inputs, START, heat, **changed_values)
    return chain.record(inputs, nodes + noise * np.random.default_rng(seed).standard_normal(nodes.shape))


def _heated(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return np.array([0.0, 0.0, 0.5 / 40 * (1005 <= t < 2005)])


def _with_source(chain, record, watts: float) -> Model:
    model = chain.model()
    setting = setting_of(model, [view(model, record)])
    candidate = next(each for each in all_candidates(setting) if str(each.cause) == "heat_source at shell")
    return model.with_effect(Effect(candidate, 1005.0, 2005.0, np.array([watts]), np.zeros((1, 1))))


@pytest.fixture(scope="module")
def heated(chain):
    return _record(chain, heat=_heated)


@pytest.mark.parametrize("name", ["C_shell", "R_chip_board"])
def test_a_parameters_column_is_the_physics_slope(chain, name: str) -> None:
    """By the logarithm of the parameter, starts held: central differences of the integrated circuit."""
    record = _record(chain, noise=0.0)
    seen = view(chain.model(), record)
    teaching = Teaching((record,), chain.noise(), (name,))
    system = joint._System.of(chain.model(), [seen], teaching)
    value, step = chain.plant().values[name], 1e-3
    up, down = (chain.integrated(record.inputs, START, **{name: value * np.exp(s)}) for s in (step, -step))
    slope = (up - down) / (2 * step)
    np.testing.assert_allclose(system.columns[0][3], slope, atol=2e-3 * np.abs(slope).max())
    for node in range(3):
        np.testing.assert_array_equal(system.columns[0][node], seen.starts[node])


def test_an_effects_column_is_what_its_coefficient_adds(chain, heated) -> None:
    model = _with_source(chain, heated, 0.5)
    seen = view(model, heated)
    system = joint._System.of(model, [seen], Teaching((heated,), chain.noise()))
    more = chain.integrated(heated.inputs, START, lambda t, x, air: 2 * _heated(t, x, air))
    once = chain.integrated(heated.inputs, START, _heated)
    np.testing.assert_allclose(0.5 * system.columns[0][-1], more - once, atol=0.01)


def test_the_end_is_that_of_another_optimiser(chain) -> None:
    """From a circuit that is half wrong to the least squares in all parameters and the start."""
    record = _record(chain, seed=2)
    names = searched(chain.circuit)
    off = {name: chain.plant().values[name] * (1.5 if index % 2 else 0.7) for index, name in enumerate(names)}
    found = fitted(chain.model(**off), Teaching((record,), chain.noise(), names), 30)

    def left(unknown: np.ndarray) -> np.ndarray:
        plant = chain.plant(**{name: float(np.exp(each)) for name, each in zip(names, unknown)})
        nodes = plant.forced(record.inputs) + np.einsum("i,ink->nk", unknown[len(names) :], plant.decays(N))
        return ((record.sensors - nodes) / 0.05)[:, ORDER:].reshape(-1)

    first = np.array([*(np.log(chain.plant().values[name]) for name in names), *START])
    best = least_squares(left, first, x_scale=np.array([0.1] * len(names) + [1.0] * 3), xtol=1e-12)
    square = np.nansum(chain.noise().white(found.views[0].residual_degC) ** 2)
    # the start is drawn to the first readings, which costs a little
    assert square == pytest.approx(2 * best.cost, rel=1e-2)
    for name, each in zip(names, best.x):
        assert found.model.plant.values[name] == pytest.approx(np.exp(each), rel=0.02)
    np.testing.assert_allclose(found.longest.start, best.x[len(names) :], atol=0.15)


def test_a_coefficient_is_found_with_its_deviation(chain, heated) -> None:
    found = fitted(_with_source(chain, heated, 0.0), Teaching((heated,), chain.noise()), 5)
    (effect,) = found.model.effects
    deviation = np.sqrt(effect.covariance[0, 0])
    assert effect.values[0] == pytest.approx(0.5, abs=4 * deviation)
    assert 1e-4 < deviation < 0.02


def test_held_out_is_a_fit_without_the_fold(chain, heated) -> None:
    """A linear coefficient, refitted by hand to the rows of the other four fifths."""
    model = _with_source(chain, heated, 0.3)
    teaching = Teaching((heated,), chain.noise())
    seen = view(model, heated)
    (held_out,) = joint._System.of(model, [seen], teaching).held_out()
    candidate = model.effects[0].candidate
    (term,) = candidate.terms(seen)
    column = beginning(seen, term, [1005.0])[0] - ending(seen, term, [2005.0])[0]
    block = blocks(heated)
    inside = block[ORDER:] == block[:-ORDER]
    fold = block[ORDER:] % FOLDS
    x, y = (chain.noise().white(each) for each in (column, seen.residual_degC))

    def solved(rows: np.ndarray) -> float:
        return float(np.linalg.lstsq(x[:, rows].reshape(-1, 1), y[:, rows].reshape(-1), rcond=None)[0][0])

    whole = solved(inside)
    assert 0.3 + whole == pytest.approx(0.5, abs=0.02)
    for own in range(FOLDS):
        step = solved(inside & (fold != own)) - whole
        mine = block % FOLDS == own
        np.testing.assert_allclose(held_out[:, mine], (seen.residual_degC - step * column)[:, mine], atol=1e-6)


def test_held_out_errors_are_no_smaller_than_fitted_ones(chain) -> None:
    record = _record(chain, seed=3)
    names = searched(chain.circuit)
    found = fitted(chain.model(), Teaching((record,), chain.noise(), names), 6)
    inner = np.nansum(found.views[0].residual_degC ** 2)
    outer = np.nansum(found.held_out_degC[0] ** 2)
    assert inner < outer < 1.1 * inner


def test_parameters_stay_within_their_bounds(chain) -> None:
    """Data of a circuit beyond the bounds: the fit ends at them, and the others still fit as well as they can."""
    record = _record(chain, seed=4, R_shell_ambient=150.0, C_chip=1.0)
    names = searched(chain.circuit)
    found = fitted(chain.model(), Teaching((record,), chain.noise(), names), 12)
    values = found.model.plant.values
    for each in chain.circuit.parameters:
        assert each.low <= values[each.name] <= each.high
    assert values["R_shell_ambient"] == 100.0
    assert values["C_chip"] == 2.0
    before = fitted(chain.model(), Teaching((record,), chain.noise()), 1)
    assert found.square < 0.2 * before.square


def test_a_fit_never_makes_it_worse(chain, heated) -> None:
    names = searched(chain.circuit)
    teaching, last = Teaching((heated,), chain.noise(), names), np.inf
    for rounds in range(5):
        found = fitted(chain.model(C_shell=80.0), teaching, rounds)
        square = np.nansum(chain.noise().white(found.views[0].residual_degC) ** 2)
        assert square <= last
        last = square


def test_several_records_share_the_circuit_but_not_the_start(chain) -> None:
    one, two = _record(chain, seed=5), _record(chain, seed=6)
    two = replace(two, sensors=chain.integrated(two.inputs, START + 5.0))
    names = searched(chain.circuit)
    found = fitted(chain.model(R_chip_board=12.0), Teaching((one, two), chain.noise(), names), 15)
    np.testing.assert_allclose(found.views[0].start, START, atol=0.2)
    np.testing.assert_allclose(found.views[1].start, START + 5.0, atol=0.2)
    assert found.model.plant.values["R_chip_board"] == pytest.approx(8.0, rel=0.02)
    assert len(found.held_out_degC) == 2


def test_what_runs_away_is_told_by_an_endless_square(chain, heated) -> None:
    model = chain.model()
    setting = setting_of(model, [view(model, heated)])
    coupling = next(each for each in all_candidates(setting) if str(each.cause) == "ambient_coupling at shell")
    wild = model.with_effect(Effect(coupling, None, None, np.array([-60.0]), np.zeros((1, 1))))
    assert fitted(wild, Teaching((heated,), chain.noise()), 2).square == np.inf


def test_blocks_are_long_enough_to_be_whitened_and_about_fifty(chain) -> None:
    for samples in (100, 1000, 3000):
        block = blocks(chain.record(np.zeros((2, samples)), np.zeros((3, samples))))
        lengths = np.bincount(block)
        assert (np.diff(block) >= 0).all()
        assert len(set(lengths[:-1])) == 1
        assert lengths[0] == max(4 * ORDER, samples // 50)


def test_moves_are_by_the_logarithm_and_held_back(chain) -> None:
    plant = chain.plant()
    assert changed(plant, "C_chip", 0.1) == pytest.approx(10 * np.exp(0.1))
    assert changed(plant, "C_chip", 9.0) == pytest.approx(10 * np.exp(0.7))
    assert changed(plant, plant.circuit.sources[0].share, -0.2) == pytest.approx(0.8)
    assert bounded(chain.plant(C_chip=45.0), "C_chip", 0.5) == 50.0
