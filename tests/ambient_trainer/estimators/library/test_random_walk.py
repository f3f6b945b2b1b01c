"""The filter of the circuit is the Kalman filter, held against one that is stepped through time."""

import numpy as np
import pytest
from scipy.linalg import expm

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimators.library.circuit_observer import RandomWalkAmbient
from ambient_trainer.lti.response import response_degC

from .conftest import walked

SENSORS = ("a_degC", "b_degC", "c_degC")


@pytest.fixture
def circuit():
    return RandomWalkAmbient(SENSORS, 0.3)


@pytest.fixture
def theta():
    return np.log([60.0, 200.0, 120.0, 1.5, 0.5, 0.002, 0.004, 0.001, 0.02, 0.05, 0.03, 0.2, 0.4, 0.1])


def searched(segments, theta):
    return RandomWalkAmbient(SENSORS, 0.3, segments, dict(zip(RandomWalkAmbient(SENSORS, 0.3).names, theta)))


def segment_of(trace):
    return Segment(10.0, np.vstack([trace.columns[name] for name in SENSORS]), trace.reference[None])


def test_it_is_the_kalman_filter_stepped_through_time(circuit, theta):
    """A discrete Kalman filter at a hundredth of the period, its covariance running from what is known at first."""
    segment = segment_of(walked(1, samples=60))
    h = 0.1
    A, Q, variance = circuit.process(theta)
    step, H, R, P = expm(A * h), np.eye(3, 4), np.diag(variance / h), np.eye(4)
    for _ in range(40_000):
        P = step @ P @ step.T + Q * h
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        P = P - K @ H @ P
    stay = step - K @ H @ step
    x = np.linalg.solve(np.eye(4) - stay, K @ segment.inputs[:, 0])
    said = [x[3]]
    for before, after in zip(segment.inputs.T, segment.inputs.T[1:]):
        for part in range(1, 101):
            x = stay @ x + K @ (before + (after - before) * part / 100)
        said.append(x[3])
    found = response_degC(circuit.filter(theta), "first-order", segment.inputs, segment.period_s)
    # h is 0.1 s, and the noise that Q adds within it is taken to come at once
    np.testing.assert_allclose(found, said, atol=0.02 * np.std(segment.outputs))
    assert np.abs(found - segment.inputs.mean(axis=0)).max() > 1.0  # it is no mean of its inputs


def test_slopes_are_differences_and_far_off_all_is_finite(theta):
    segment = segment_of(walked(2, samples=200))
    structure = searched([segment], theta)
    slopes = structure.slopes(theta, np.zeros(1), 0)
    for index, h in enumerate(1e-5 * np.eye(len(theta))):
        across = (structure.regressors(theta + h, 0)[0] - structure.regressors(theta - h, 0)[0]) / 2e-5
        np.testing.assert_allclose(slopes[index], across, atol=1e-6 * max(1.0, np.abs(across).max()))
    structure = searched([segment_of(walked(2, samples=50))], theta)
    with np.errstate(all="ignore"):
        for far in (theta + 300.0, theta + 8.0, theta - 8.0):
            assert np.isfinite(structure.regressors(far, 0)[0]).all()
            assert np.isfinite(structure.slopes(far, np.zeros(1), 0)).all()
