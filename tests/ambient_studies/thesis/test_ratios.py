"""Ratios of first-order responses: outputs against the filter itself, derivatives against finite differences."""

import numpy as np
import pytest

from ambient_studies.thesis.related._ratios import FirstOrderRatios
from ambient_studies.thesis.related._samples import lagged
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.structure import project

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


def test_the_outputs_are_the_filters_and_the_slopes_are_derivatives() -> None:
    structure, beta, step = structure_of(), np.array([0.7, -0.2, 1.1, -0.4, 5.0]), 1e-5
    for index, segment in enumerate(structure.segments):
        filtered = expected(segment.inputs, beta[:2], beta[2:4], 5.0)
        assert structure.predicted(np.log(TAUS_S), beta, index)[0] == pytest.approx(filtered, abs=1e-8)
    theta = np.log([30.0, 40.0])
    for slope, move in zip(structure.slopes(theta, beta, 0), step * np.eye(2)):
        around = (structure.predicted(theta + each, beta, 0) for each in (move, -move))
        assert slope == pytest.approx(np.subtract(*around) / (2 * step), rel=1e-6, abs=1e-6)


def test_at_the_true_time_constants_the_gains_are_exact_and_keep_their_sign() -> None:
    structure = structure_of()
    found = project(structure, np.log(TAUS_S))
    assert found.beta == pytest.approx([2.0, -0.5, 1.2, -0.8, 3.0], abs=1e-7)
    turned = structure_of(signs=(-1, 1))
    held = project(turned, np.log(TAUS_S))
    assert (held.beta[[0, 2]] <= 0).all()
    assert (held.beta[[1, 3]] >= 0).all()
    assert (held.beta[:4] == 0).any(), "data of the other signs leave something at its bound"
