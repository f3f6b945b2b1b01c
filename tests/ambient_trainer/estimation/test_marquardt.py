"""Least squares in a box: certified and textbook problems, bounds that hold, ranks that lack."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from ambient_trainer.estimation.search import descend
from ambient_trainer.estimation.structure import Projection

INF = np.inf


def _descend(residual, jacobian, start, low=-INF, high=INF, most=400):
    """The end, and every point that was asked for."""
    asked = []
    start = np.array(start, dtype=float)

    def evaluate(point):
        asked.append(point.copy())
        return Projection(residual(point), jacobian(point))

    low, high = (np.broadcast_to(each, start.shape).astype(float) for each in (low, high))
    return descend(evaluate, start, low, high, most), np.array(asked)


def _differences(residual, h=1e-6):
    def jacobian(point):
        steps = h * np.maximum(np.abs(point), 1e-3)
        return np.array(
            [(residual(point + s * e) - residual(point - s * e)) / (2 * s) for s, e in zip(steps, np.eye(len(point)))]
        ).T

    return jacobian


def _rosenbrock(x):
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


# Kowalik and Osborne, in More, Garbow and Hillstrom 1981, ACM TOMS 7(1), problem 15
KOWALIK_Y = np.array([0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246])
KOWALIK_U = np.array([4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])


def _kowalik(x):
    return KOWALIK_Y - x[0] * (KOWALIK_U**2 + KOWALIK_U * x[1]) / (KOWALIK_U**2 + KOWALIK_U * x[2] + x[3])


# NIST Statistical Reference Datasets, nonlinear regression: Misra1a, y = b1 (1 - exp(-b2 x))
MISRA_X = np.array([77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0])
MISRA_Y = np.array([10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78])
MISRA_CERTIFIED = np.array([2.3894212918e02, 5.5015643181e-04])
MISRA_SQUARE = 1.2455138894e-01


def _misra(logs):
    return MISRA_Y - np.exp(logs[0]) * (1 - np.exp(-np.exp(logs[1]) * MISRA_X))


@pytest.mark.parametrize(
    ("residual", "start", "square"),
    [
        (_rosenbrock, [-1.2, 1.0], 0.0),
        (_rosenbrock, [1.0, 1.0], 0.0),
        (_kowalik, [0.25, 0.39, 0.415, 0.39], 3.07505e-4),
    ],
)
def test_published_problems(residual, start, square):
    (end, settled), asked = _descend(residual, _differences(residual), start)
    assert settled
    assert np.sum(residual(end) ** 2) == pytest.approx(square, rel=1e-5, abs=1e-11)
    assert (len(asked) == 1) == (start == [1.0, 1.0])


@pytest.mark.parametrize("start", [[500.0, 1e-4], [250.0, 5e-4]])
def test_misra_is_as_certified(start):
    """Both of the published starts; the scale of the two unknowns differs by 10^6."""
    (end, settled), _ = _descend(_misra, _differences(_misra), np.log(start), most=100)
    assert settled
    np.testing.assert_allclose(np.exp(end), MISRA_CERTIFIED, rtol=1e-4)
    assert np.sum(_misra(end) ** 2) == pytest.approx(MISRA_SQUARE, rel=1e-8)


@pytest.mark.parametrize(
    ("residual", "start", "low", "high"),
    [
        (_rosenbrock, [-1.2, 1.0], [-2, -1], [0.5, 2]),
        (_rosenbrock, [-1.2, 1.0], [-2, 1.5], [2, 3]),
        (_rosenbrock, [2.0, 2.0], [1.5, -1], [3, 9]),
        (_kowalik, [0.2, 0.3, 0.3, 0.3], [0, 0, 0, 0], [0.18, 1, 1, 1]),
    ],
)
def test_with_a_bound_that_holds_it_ends_where_scipy_does(residual, start, low, high):
    (end, settled), asked = _descend(residual, _differences(residual), start, low, high)
    wanted = least_squares(residual, np.clip(start, low, high), bounds=(low, high), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert settled
    assert (wanted.active_mask != 0).any()
    assert np.sum(residual(end) ** 2) == pytest.approx(2 * wanted.cost, rel=1e-6)
    np.testing.assert_allclose(end, wanted.x, atol=2e-4)
    held = wanted.active_mask != 0
    np.testing.assert_array_equal(end[held], np.where(wanted.active_mask < 0, low, high)[held])
    assert ((low <= asked) & (asked <= high)).all()


def test_missing_rank_is_no_obstacle():
    """Only the sum of the first two unknowns shows, and the third not at all."""
    x = np.linspace(0, 3, 20)
    y = 2 * np.exp(-0.7 * x)

    def residual(p):
        return y - np.exp(-(p[0] + p[1]) * x) * p[3]

    (end, settled), _ = _descend(residual, _differences(residual), [0.1, 0.2, 5.0, 1.0])
    assert settled
    assert end[2] == pytest.approx(5.0, rel=1e-12)  # to rounding, which follows the processor
    assert [end[0] + end[1], end[3]] == pytest.approx([0.7, 2.0], abs=1e-6)


def test_a_column_of_rounding_does_not_throw_its_unknown_across_the_box():
    random = np.random.default_rng(0)
    noise = random.normal(size=20) * 1e-14
    x = np.linspace(0, 3, 20)
    y = 2 * np.exp(-0.7 * x) + random.normal(size=20) * 0.1

    def jacobian(p):
        return np.column_stack([p[1] * x * np.exp(-p[0] * x), -np.exp(-p[0] * x), noise])

    (end, settled), _ = _descend(lambda p: y - p[1] * np.exp(-p[0] * x), jacobian, [0.3, 1.0, 0.5], -20, 20)
    assert settled
    assert abs(end[2] - 0.5) < 0.5
