"""The structure's outputs and derivatives, against the filter itself and finite differences."""

import numpy as np
import pytest

from ambient_studies.related.first_order import lagged
from ambient_studies.related.ratios import FirstOrderRatios
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.separable import project
from ambient_trainer.estimation.structure import linearise

TAUS_S = np.array([15.0, 90.0])
PERIOD_S = 2.0


def structure_of(signs: tuple[int, int] = (1, -1)) -> FirstOrderRatios:
    rng = np.random.default_rng(1)
    found = []
    for count in (300, 200):
        inputs = 20.0 + np.cumsum(rng.normal(0.0, 0.5, (2, count)), axis=1)
        outputs = expected(inputs, np.array([2.0, -0.5]), np.array([1.2, -0.8]), 3.0)
        found.append(Segment(PERIOD_S, inputs, outputs[None]))
    return FirstOrderRatios(found, signs)


def expected(inputs: np.ndarray, direct: np.ndarray, gain: np.ndarray, offset: float) -> np.ndarray:
    time_s = np.arange(inputs.shape[1]) * PERIOD_S
    slow = np.vstack([lagged(time_s, row, tau) for row, tau in zip(inputs, TAUS_S)])
    return offset + direct @ (inputs - slow) + gain @ slow


def test_the_expansion_is_the_filter() -> None:
    structure = structure_of()
    beta = np.array([0.7, -0.2, 1.1, -0.4, 5.0])

    expansion = structure.expand(np.log(TAUS_S), PERIOD_S)

    assert np.all(expansion.fixed == 0.0)
    for index, segment in enumerate(structure.segments):
        outputs = structure.signals(np.log(TAUS_S), index).T @ expansion.free[0] @ beta
        assert outputs == pytest.approx(expected(segment.inputs, beta[:2], beta[2:4], 5.0), abs=1e-8)


def test_at_the_truth_the_gains_are_solved_for_exactly() -> None:
    structure = structure_of()

    found = project(linearise(structure, np.log(TAUS_S)), structure.linear)

    assert found.beta == pytest.approx([2.0, -0.5, 1.2, -0.8, 3.0], abs=1e-7)
    assert np.linalg.norm(found.residual) < 1e-7


def test_the_derivatives_are_those_of_the_outputs() -> None:
    structure = structure_of()
    theta, beta, step = np.log([30.0, 40.0]), np.array([0.7, -0.2, 1.1, -0.4, 5.0]), 1e-5

    def outputs(at: np.ndarray) -> np.ndarray:
        return structure.signals(at, 0).T @ structure.expand(at, PERIOD_S).free[0] @ beta

    slopes = structure.expand(theta, PERIOD_S).free_slope
    for k in range(2):
        moved = step * np.eye(2)[k]
        numeric = (outputs(theta + moved) - outputs(theta - moved)) / (2 * step)
        assert structure.signals(theta, 0).T @ slopes[k, 0] @ beta == pytest.approx(numeric, rel=1e-6, abs=1e-6)


def test_gains_keep_their_sign() -> None:
    structure = structure_of(signs=(-1, 1))

    found = project(linearise(structure, np.log(TAUS_S)), structure.linear)

    assert (found.beta[[0, 2]] <= 0).all()
    assert (found.beta[[1, 3]] >= 0).all()
    assert (found.beta[:4] == 0).any(), "data of the other signs leave something at its bound"
