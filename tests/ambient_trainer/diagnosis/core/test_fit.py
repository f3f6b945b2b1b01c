"""The joint fit: its end against another optimiser's, folds and covariance by hand, intervals by counting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ambient_trainer.diagnosis import fit
from ambient_trainer.diagnosis.fit import FOLDS, TrainingSet, blocks, fit_model, information, nuisance_columns
from ambient_trainer.diagnosis.model import Model, view
from ambient_trainer.diagnosis.prior import Prior
from ambient_trainer.diagnosis.sensitivities import columns
from ambient_trainer.diagnosis.terms import beginning, ending
from ambient_trainer.diagnosis.training import searched
from ambient_trainer.estimation.noise import ORDER, Noise

N = 360
START = np.array([30.0, 26.0, 22.0])


def _record(chain, seed: int = 1, heat=None, noise: float = 0.05, **changed_values: float):
    inputs = chain.inputs(N, seed)
    nodes = chain.integrated(inputs, START, heat, **changed_values)
    return chain.record(inputs, nodes + noise * np.random.default_rng(seed).standard_normal(nodes.shape))


def _heated(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return np.array([0.0, 0.0, 0.5 / 40 * (1005 <= t < 2005)])


def _with_source(chain, record, watts: float) -> Model:
    return chain.model().with_effect(chain.effect(record, "heat_source at shell", (watts,), 1005.0, 2005.0))


@pytest.fixture(scope="module")
def heated(chain):
    return _record(chain, heat=_heated)


def test_the_end_is_that_of_another_optimiser(chain) -> None:
    """From a circuit that is half wrong to the least squares in all parameters and the start."""
    record = _record(chain, seed=2)
    names = searched(chain.circuit)
    off = {name: chain.plant().values[name] * (1.5 if index % 2 else 0.7) for index, name in enumerate(names)}
    found = fit_model(chain.model(**off), TrainingSet((record,), chain.noise(), names), 30)

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


def _bridge(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return (x[2] - x[0]) / 15.0 * np.array([1 / 10, 0.0, -1 / 40])


def _bent(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return -0.08 * (x - air) * np.abs(x - air) * np.array([0.0, 1 / 30 / 25, 1 / 15 / 40])


@pytest.mark.parametrize(
    ("cause", "heat", "values", "start", "truth"),
    [
        # straight in the conductances that it trades
        ("path at chip-shell", _bridge, ("R_board_shell", 12.0), (0.0,), 1 / 15),
        # relative to the conductances: straight in their logarithms
        ("convection_law", _bent, ("R_shell_ambient", 15.0), (0.0, 0.0), 0.08),
    ],
)
def test_a_few_steps_lead_along_a_valley(chain, cause: str, heat, values, start, truth: float) -> None:
    """From the circuit that fits best without the effect, far from the truth in all its parameters."""
    inputs = chain.inputs(540, 8)
    nodes = chain.integrated(inputs, START, heat)
    record = chain.record(inputs, nodes + 0.03 * np.random.default_rng(8).standard_normal(nodes.shape))
    names = searched(chain.circuit)
    training = TrainingSet((record,), chain.noise(0.03), names, Prior.by_design(chain.model(), names))
    without = fit_model(chain.model(), training, 40).model
    name, true = values
    assert abs(np.log(without.plant.values[name] / true)) > 0.3
    found = fit_model(without.with_effect(chain.effect(record, cause, start)), training, 6)
    assert found.model.effects[0].values[0] == pytest.approx(truth, rel=0.08)
    assert found.model.plant.values[name] == pytest.approx(true, rel=0.08)
    assert np.sqrt(np.mean(found.longest.residual_degC**2)) < 0.033


def test_edges_are_found_between_the_samples(chain) -> None:
    record = _record(chain, seed=8, heat=lambda t, x, air: np.array([0, 0, 1.5 / 40 * (1013 <= t < 2021)]), noise=0.02)
    model = chain.model().with_effect(chain.effect(record, "heat_source at shell", (1.0,), 955.0, 2095.0))
    (effect,) = fit_model(model, TrainingSet((record,), chain.noise(0.02)), 20).model.effects
    assert effect.onset_s == pytest.approx(1013.0, abs=5.0)
    assert effect.end_s == pytest.approx(2021.0, abs=5.0)
    assert effect.values[0] == pytest.approx(1.5, rel=0.01)


def test_a_shape_is_found_with_its_deviation(chain) -> None:
    def mass(t: float, x: np.ndarray, air: float) -> np.ndarray:
        flow = (x[1] - x[3]) * 0.2
        return np.array([0.0, -flow / 25, 0.0, flow / 60])

    inputs = chain.inputs(N, 7)
    nodes = chain.integrated(inputs, np.append(START, START[1]), mass)[:3]
    record = chain.record(inputs, nodes + 0.05 * np.random.default_rng(7).standard_normal(nodes.shape))
    model = chain.model().with_effect(chain.effect(record, "thermal_mass at board", (0.1,), shape=700.0))
    found = fit_model(model, TrainingSet((record,), chain.noise()), 20)
    (effect,) = found.model.effects
    coefficient, log_shape = np.sqrt(np.diag(effect.covariance))
    assert effect.values[0] == pytest.approx(0.2, abs=4 * coefficient)
    assert np.log(effect.candidate.shape / 300.0) == pytest.approx(0.0, abs=4 * log_shape)
    assert 1e-4 < log_shape < 0.1
    told = effect.magnitude(found.longest)
    assert told.ci95[0] < 60.0 < told.ci95[1]
    assert told.value == pytest.approx(60.0, rel=0.05)


def _by_hand(training: TrainingSet, seen, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All columns, whitened, (R, c), the residual, (R,), which rows lie in one block, and their twelfth of time."""
    own = np.concatenate([seen.starts, columns(model, training.searched, training.free(model), seen)])
    block, count = blocks(seen.record), len(seen.residual_degC)
    inside = np.tile(block[ORDER:] == block[:-ORDER], count)
    twelfth = np.tile(block[ORDER:] * 12 // (block[-1] + 1), count)
    X = training.noise.white(own).reshape(len(own), -1).T
    return X, training.noise.white(seen.residual_degC).reshape(-1), inside, twelfth


@pytest.mark.parametrize("known", [False, True])
def test_the_covariance_is_the_sandwich_by_clusters(chain, heated, known: bool) -> None:
    """(X'X + P)^-1 and what twelve stretches of time disagree by, from plain arrays."""
    names = ("C_shell", "R_shell_ambient")
    model = _with_source(chain, heated, 0.5)
    prior = Prior.by_design(model, names) if known else None
    training = TrainingSet((heated,), chain.noise(), names, prior)
    seen = view(model, heated)
    X, y, inside, twelfth = _by_hand(training, seen, model)
    variance = y @ y / (len(y) - X.shape[1])
    H = X[inside].T @ X[inside] / variance
    if known:
        H[3:5, 3:5] += np.diag([(4 / np.log(200 / 8)) ** 2, (4 / np.log(100 / 3)) ** 2])
    pulls = np.array([X[twelfth == each].T @ y[twelfth == each] for each in range(12)]) / variance
    wanted = np.linalg.inv(H) @ (H + pulls.T @ pulls) @ np.linalg.inv(H)
    system = fit._System.of(model, [seen], training)
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(system.covariance() / np.outer(size, size), wanted / np.outer(size, size), atol=1e-5)
    (effect,) = system.with_covariance(model).effects
    assert effect.covariance[0, 0] == pytest.approx(wanted[5, 5], rel=1e-5)


def test_intervals_hold_the_truth_as_often_as_they_say(chain) -> None:
    """Of a heat among resistances that are free, under noise that remembers: 60 runs."""
    names = ("R_board_ambient", "R_shell_ambient", "C_shell")
    random = np.random.default_rng(21)
    inputs = chain.inputs(N, 9)
    nodes = chain.integrated(inputs, START, _heated)

    def noise() -> np.ndarray:
        rows = 0.05 * random.standard_normal((3, N + 50))
        for k in range(1, rows.shape[1]):
            rows[:, k] += 0.7 * rows[:, k - 1]
        return rows[:, 50:]

    known = Noise.of([noise() for _ in range(10)])
    model = _with_source(chain, chain.record(inputs, nodes), 0.4)
    prior = Prior.by_design(model, names)
    off = []
    for _ in range(60):
        record = chain.record(inputs, nodes + noise())
        (effect,) = fit_model(model, TrainingSet((record,), known, names, prior), 6).model.effects
        off.append((effect.values[0] - 0.5) / np.sqrt(effect.covariance[0, 0]))
    assert 51 <= np.sum(np.abs(off) < 1.96) <= 60
    # nor are they so wide that they say nothing
    assert 0.5 < np.std(off) < 1.4


def test_one_step_is_least_squares(chain, heated) -> None:
    names = ("C_shell", "R_shell_ambient")
    model = _with_source(chain, heated, 0.3)
    training = TrainingSet((heated,), chain.noise(), names, Prior.by_design(model, names))
    seen = view(model, heated)
    X, y, inside, _ = _by_hand(training, seen, model)
    rows, off = training.prior.rows(model, 1.0)
    # the file speaks of the parameters and, with no weight, of known effects; these there are none
    more = np.zeros((2, X.shape[1]))
    more[:, 3:5] = rows[:2, :2]
    wanted = np.linalg.lstsq(np.concatenate([X[inside], more]), np.concatenate([y[inside], off[:2]]), rcond=None)[0]
    found = fit._System.of(model, [seen], training).solution(model, 1e-9)
    np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-5)
    # damping (Marquardt) shortens every step
    damped = fit._System.of(model, [seen], training).solution(model, 30.0)
    assert (np.abs(damped[5]) < 0.1 * np.abs(wanted[5])).all()


def test_what_a_bound_stops_is_not_counted_on(chain) -> None:
    """A coupling at its most: it stays there, and the others take the step that is best without it."""
    record = _record(chain, heat=lambda t, x, air: np.array([0.0, 0.0, -14.0 * (x[2] - air) / 15 / 40]))
    names = ("C_shell", "R_board_shell")
    model = chain.model().with_effect(chain.effect(record, "ambient_coupling at shell", (8.9,)))
    training = TrainingSet((record,), chain.noise(), names)
    seen = view(model, record)
    X, y, inside, _ = _by_hand(training, seen, model)
    X, y = X[inside], y[inside]
    free = np.linalg.lstsq(X, y, rcond=None)[0]
    assert free[5] > 0.5
    step = fit._System.of(model, [seen], training).solution(model, 1e-9)
    assert step[5] == pytest.approx(0.1)
    wanted = np.linalg.lstsq(X[:, :5], y - 0.1 * X[:, 5], rcond=None)[0]
    np.testing.assert_allclose(step[:5], wanted, rtol=1e-3, atol=1e-5)
    assert np.abs(free[3:5] - wanted[3:5]).max() > 1e-3


def test_held_out_is_a_fit_without_the_fold(chain, heated) -> None:
    """A linear coefficient, refitted by hand to the rows of the other four fifths."""
    model = _with_source(chain, heated, 0.3)
    training = TrainingSet((heated,), chain.noise())
    seen = view(model, heated)
    (held_out,) = fit._System.of(model, [seen], training).held_out()
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


def test_parameters_stay_within_their_bounds(chain) -> None:
    """Data of a circuit beyond the bounds: the fit ends at them, and the others still fit as well as they can."""
    record = _record(chain, seed=4, R_shell_ambient=150.0, C_chip=1.0)
    names = searched(chain.circuit)
    found = fit_model(chain.model(), TrainingSet((record,), chain.noise(), names), 12)
    values = found.model.plant.values
    for each in chain.circuit.parameters:
        assert each.low <= values[each.name] <= each.high
    assert values["R_shell_ambient"] == 100.0
    assert values["C_chip"] == 2.0
    before = fit_model(chain.model(), TrainingSet((record,), chain.noise()), 1)
    assert found.square < 0.2 * before.square


def test_a_fit_never_makes_it_worse(chain, heated) -> None:
    names = searched(chain.circuit)
    training, last = TrainingSet((heated,), chain.noise(), names), np.inf
    for rounds in range(5):
        found = fit_model(chain.model(C_shell=80.0), training, rounds)
        square = np.nansum(chain.noise().white(found.views[0].residual_degC) ** 2)
        assert square <= last
        last = square


def test_several_records_share_the_circuit_but_not_the_start(chain) -> None:
    one, two = _record(chain, seed=5), _record(chain, seed=6)
    two = replace(two, sensors=chain.integrated(two.inputs, START + 5.0))
    names = searched(chain.circuit)
    found = fit_model(chain.model(R_chip_board=12.0), TrainingSet((one, two), chain.noise(), names), 15)
    np.testing.assert_allclose(found.views[0].start, START, atol=0.2)
    np.testing.assert_allclose(found.views[1].start, START + 5.0, atol=0.2)
    assert found.model.plant.values["R_chip_board"] == pytest.approx(8.0, rel=0.02)
    assert len(found.held_out_degC) == 2


def test_what_runs_away_is_told_by_an_endless_square(chain, heated) -> None:
    model = chain.model()
    wild = model.with_effect(chain.effect(heated, "ambient_coupling at shell", (-60.0,)))
    assert fit_model(wild, TrainingSet((heated,), chain.noise()), 2).square == np.inf


def test_blocks_are_long_enough_to_be_whitened_and_about_fifty(chain) -> None:
    for samples in (100, 1000, 3000):
        block = blocks(chain.record(np.zeros((2, samples)), np.zeros((3, samples))))
        lengths = np.bincount(block)
        assert (np.diff(block) >= 0).all()
        assert len(set(lengths[:-1])) == 1
        assert lengths[0] == max(4 * ORDER, samples // 50)


def test_information_is_the_inverse_of_the_covariance(chain, heated) -> None:
    names = searched(chain.circuit)
    model = chain.model()
    training = TrainingSet((heated,), chain.noise(), names, Prior.by_design(model, names))
    found = information(model, training)
    system = fit._System.of(model, [view(model, heated)], training)
    own = system.covariance()[3:, 3:]
    assert found.shape == (7, 7)
    np.testing.assert_allclose(found @ own, np.eye(7), atol=1e-5)


def test_nuisances_are_all_that_is_free_and_what_is_known_of_it(chain, heated) -> None:
    names = ("C_shell", "R_shell_ambient")
    model = _with_source(chain, heated, 0.3)
    plain = TrainingSet((heated,), chain.noise(), names)
    current = fit_model(model, plain, 0)
    (found,), told = nuisance_columns(current, plain)
    np.testing.assert_allclose(found, columns(model, names, plain.free(model), current.longest))
    assert told is None
    prior = Prior.by_design(chain.model(C_shell=55.0), names)
    (found,), (rows, off) = nuisance_columns(current, replace(plain, prior=prior))
    # per row what each nuisance does: a parameter's own, an effect's nothing
    C, R = 4 / np.log(200 / 8), 4 / np.log(100 / 3)
    assert rows.shape == (5, 2)
    np.testing.assert_allclose(np.abs(rows[:2]).max(axis=1), [C, R])
    assert not rows[2:].any()
    np.testing.assert_allclose(off, [0.0, 0.0], atol=1e-12)
