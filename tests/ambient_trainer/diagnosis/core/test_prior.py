"""What is known beforehand: a quadratic written by hand, and the ball that it may not be left by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from ambient_trainer.diagnosis.circuit_parameters import changed
from ambient_trainer.diagnosis.model import Effect, Model
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.prior import Prior

NAMES = ("C_shell", "R_shell_ambient", "share")


@pytest.fixture(scope="module")
def always(shared) -> Effect:
    """An effect that was there in the known-good records: a contact, which has two coefficients."""
    inputs = shared.inputs(80)
    record = shared.record(inputs, shared.integrated(inputs, np.array([30.0, 26.0, 22.0])))
    return replace(shared.effect(record, "contact at shell", (0.2, 2.0)), known=True)


def _model(shared, effects: tuple[Effect, ...] = (), **changed_values: float) -> Model:
    return Model(shared.plant(**changed_values), effects)


def _moved(model: Model, step: np.ndarray) -> Model:
    """``model`` with its three parameters and its effect's coefficients moved."""
    plant = model.plant
    values = {**plant.values, **{name: changed(plant, name, each) for name, each in zip(NAMES, step)}}
    effects = tuple(replace(each, values=each.values + step[3:]) for each in model.effects)
    return Model(Plant.of(plant.circuit, values, plant.period_s), effects)


def test_by_design_is_a_quadratic_about_the_files_values(shared) -> None:
    """Four standard deviations from one bound to the other, in the logarithm; a share as it is."""
    prior = Prior.by_design(_model(shared, C_shell=77.0), NAMES)
    C, R, share = 30.0, 21.0, 1.1
    away = [
        np.log(C / 40) / (np.log(200 / 8) / 4),
        np.log(R / 15) / (np.log(100 / 3) / 4),
        (share - 0.6) / (2.0 / 4),
    ]
    model = _model(shared, C_shell=C, R_shell_ambient=R, share=share)
    assert prior.square(model) == pytest.approx(np.sum(np.square(away)))
    assert prior.square(_model(shared)) == 0.0
    assert prior.square(_model(shared, R_chip_board=59.0)) == 0.0


def test_what_the_file_says_nothing_of_is_free(shared, always) -> None:
    """The known effects' coefficients, from which the file does not hold: only records can teach them."""
    prior = Prior.by_design(_model(shared, (always,)), NAMES)
    assert prior.information.shape == (5, 5)
    assert prior.square(_model(shared, (replace(always, values=np.array([9.0, -9.0])),))) == 0.0


def _taught(shared, always) -> Prior:
    random = np.random.default_rng(5)
    root = random.standard_normal((5, 5))
    return Prior.trained(_model(shared, (always,)), NAMES, root @ root.T * 40.0)


@pytest.mark.parametrize("share", [0.6, 1.3, 0.04])
@pytest.mark.parametrize("kind", ["by design", "trained"])
def test_the_normal_equations_are_the_squares_own(shared, always, kind: str, share: float) -> None:
    """Of any step from any model: square(there) = square(here) - 2 step side + step matrix step."""
    here = _model(shared, (replace(always, values=np.array([0.21, 1.97])),), C_shell=42.0, share=share)
    prior = Prior.by_design(here, NAMES) if kind == "by design" else replace(_taught(shared, always), limit=np.inf)
    matrix, side = prior.normal(here, 1.0)
    np.testing.assert_allclose(matrix, matrix.T)
    random = np.random.default_rng(6)
    for _ in range(5):
        step = 0.2 * random.standard_normal(5)
        wanted = prior.square(here) - 2 * step @ side + step @ matrix @ step
        assert prior.square(_moved(here, step)) == pytest.approx(wanted, rel=1e-9)
    double, twice = prior.normal(here, 2.0)
    np.testing.assert_allclose(double, 2 * matrix)
    np.testing.assert_allclose(twice, 2 * side)


@pytest.mark.parametrize("factor", [1.0, 64.0])
def test_rows_say_the_same(shared, always, factor: float) -> None:
    prior = _taught(shared, always)
    here = _model(shared, (replace(always, values=np.array([0.25, 1.9])),), R_shell_ambient=13.0, share=1.3)
    matrix, side = prior.normal(here, factor)
    rows, off = prior.rows(here, factor)
    np.testing.assert_allclose(rows.T @ rows, matrix, atol=1e-9 * np.abs(matrix).max())
    np.testing.assert_allclose(rows.T @ off, side, atol=1e-9 * np.abs(side).max())
    assert off @ off == pytest.approx(factor * replace(prior, limit=np.inf).square(here))


def test_the_ball_is_that_of_95_percent(shared, always) -> None:
    prior = _taught(shared, always)
    assert prior.limit == pytest.approx(chi2.ppf(0.95, 5))
    step = np.linalg.inv(np.linalg.cholesky(prior.information).T)[:, 0]
    for share, inside in ((0.99, True), (1.2, True), (1.3, False)):
        # measured with a little slack: a step is only found by a line
        there = _moved(prior.about, np.sqrt(prior.limit) * share * step)
        assert np.isfinite(prior.square(there)) == inside


FIRST = 2


@pytest.mark.parametrize("strength", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("seed", range(4))
def test_a_step_stays_in_the_ball(shared, always, seed: int, strength: float) -> None:
    """Rows that pull more strongly than what was trained holds: it is held harder, by no more than is needed."""
    prior = _taught(shared, always)
    here = _moved(prior.about, 0.02 * np.random.default_rng(seed).standard_normal(5))
    random = np.random.default_rng(seed + 10)
    X = np.sqrt(strength) * random.standard_normal((60, FIRST + 5))
    y = X @ (0.5 * random.standard_normal(FIRST + 5)) + random.standard_normal(60)
    factor = prior.factor(here, X.T @ X, X.T @ y, FIRST)

    def square(by: float) -> float:
        """Of what least squares of all rows at once comes to."""
        rows, off = prior.rows(here, by)
        both = np.concatenate([X, np.concatenate([np.zeros((5, FIRST)), rows], axis=1)])
        step = np.linalg.lstsq(both, np.concatenate([y, off]), rcond=None)[0]
        return replace(prior, limit=np.inf).square(_moved_by_hand(here, step[FIRST:]))

    assert square(factor) <= prior.limit * 1.001
    assert factor == 1.0 or square(factor / 2) > prior.limit
    assert strength == 1.0 or factor > 1.0


def _moved_by_hand(here: Model, step: np.ndarray) -> Model:
    """As by :func:`_moved`, of a step of any length: ``changed`` holds long ones back."""
    half = here
    for _ in range(16):
        # a share's unit would shrink with it
        unit = half.plant.values["share"] / here.plant.values["share"]
        half = _moved(half, np.concatenate([step[:2], [step[2] / unit], step[3:]]) / 16)
    return half


def test_what_the_records_agree_with_is_not_held_harder(shared, always) -> None:
    prior = _taught(shared, always)
    matrix = 1e4 * np.eye(FIRST + 5)
    assert prior.factor(prior.about, matrix, np.zeros(FIRST + 5), FIRST) == 1.0
    by_design = Prior.by_design(prior.about, NAMES)
    assert by_design.factor(prior.about, matrix, np.full(FIRST + 5, 1e9), FIRST) == 1.0
