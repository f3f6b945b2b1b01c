"""The doubled solution is that of other people's solvers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are, solve_discrete_are

from ambient_trainer.lti.riccati import Unsettled, continuous_covariance, sampled_covariance


def drawn(seed: int, n: int, outputs: int):
    """A stable system, what it shows, its noise and that of the sensors."""
    random = np.random.default_rng(seed)
    A = random.standard_normal((n, n))
    A -= (np.abs(np.linalg.eigvals(A).real).max() + random.uniform(0.01, 1)) * np.eye(n)
    H = random.standard_normal((outputs, n))
    half = random.standard_normal((n, n))
    return A, H, half @ half.T, np.diag(np.exp(random.normal(0, 2, outputs)))


systems = st.tuples(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 3))


@given(systems)
def test_continuous_as_scipy(which):
    A, H, Q, R = drawn(*which)
    found = continuous_covariance(A, H.T @ np.linalg.solve(R, H), Q)
    np.testing.assert_allclose(found, solve_continuous_are(A.T, H.T, Q, R), rtol=1e-7, atol=1e-9 * np.abs(found).max())


@given(systems)
def test_sampled_as_scipy(which):
    A, H, Q, R = drawn(*which)
    step = A / (1.1 * np.abs(np.linalg.eigvals(A)).max())
    found = sampled_covariance(step, H.T @ np.linalg.solve(R, H), Q)
    np.testing.assert_allclose(found, solve_discrete_are(step.T, H.T, Q, R), rtol=1e-7, atol=1e-9 * np.abs(found).max())


def test_a_stack_is_each_of_it():
    pairs = [drawn(seed, 3, 2) for seed in (1, 2, 3)]
    stacked = [np.array(each) for each in zip(*[(A, H.T @ np.linalg.solve(R, H), Q) for A, H, Q, R in pairs])]
    found = continuous_covariance(*stacked)
    for index in range(3):
        alone = continuous_covariance(*(each[index] for each in stacked))
        np.testing.assert_allclose(found[index], alone, rtol=1e-9)


def test_a_complex_step_is_the_derivative():
    A, H, Q, R = drawn(3, 4, 2)
    G = H.T @ np.linalg.solve(R, H)
    toward = np.random.default_rng(0).standard_normal((4, 4))
    slope = continuous_covariance(A + 1e-30j * toward, G + 0j, Q + 0j).imag / 1e-30
    h = 1e-5
    across = (continuous_covariance(A + h * toward, G, Q) - continuous_covariance(A - h * toward, G, Q)) / (2 * h)
    np.testing.assert_allclose(slope, across, rtol=1e-6, atol=1e-8 * np.abs(across).max())


def test_what_nobody_sees_grow_has_no_steady_state():
    with pytest.raises(Unsettled), np.errstate(all="ignore"):
        sampled_covariance(np.diag([1.5, 0.5]), np.diag([0.0, 1.0]), np.eye(2))
