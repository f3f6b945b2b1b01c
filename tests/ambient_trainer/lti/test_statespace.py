"""What balanced truncation must keep; array responses are those of the recursion, sample by sample."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from ambient_trainer.lti.response import noise_gain, response_degC, states
from ambient_trainer.lti.statespace import StateSpace, dc_gain, reduced


def system(A, B, C):
    return StateSpace(A, B, C, np.zeros((1, B.shape[1])), np.array([0.3]))


def response(found, frequency):
    return found.D + found.C @ np.linalg.solve(1j * frequency * np.eye(len(found.A)) - found.A, found.B)


def test_few_enough_states_stay_and_those_that_say_the_same_twice_go_without_a_trace():
    small = system(-np.eye(3), np.ones((3, 2)), np.ones((1, 3)))
    assert reduced(small, 4) is small
    A = np.array([[-1.0, 0.3], [0.0, -0.2]])
    B, C = np.array([[1.0, 0.5], [0.2, -1.0]]), np.array([[1.0, 2.0]])
    once = system(A, B, C)
    found = reduced(system(np.kron(np.eye(2), A), np.vstack([B, B]), np.hstack([C, C]) / 2), 2)
    assert found.offset == once.offset
    for frequency in (0.0, 0.1, 1.0, 10.0):
        np.testing.assert_allclose(response(found, frequency), response(once, frequency), atol=1e-7)


def test_gains_at_rest_stay_and_the_error_is_bounded():
    random = np.random.default_rng(4)
    A = random.standard_normal((6, 6))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(6)
    whole = system(A, random.standard_normal((6, 3)), random.standard_normal((1, 6)))
    found = reduced(whole, 4)
    assert found.A.shape == (4, 4)
    assert np.linalg.eigvals(found.A).real.max() < 0
    np.testing.assert_allclose(dc_gain(found), dc_gain(whole), rtol=1e-10)
    frequencies = np.geomspace(1e-3, 1e3, 200)
    off = max(np.abs(response(found, each) - response(whole, each)).max() for each in frequencies)
    drive, seen = (solve_continuous_lyapunov(M, -N @ N.T) for M, N in ((A, whole.B), (A.T, whole.C.T)))
    hankel = np.sqrt(np.sort(np.linalg.eigvals(drive @ seen).real)[::-1].clip(0))
    # Glover 1984: twice the sum of what is left out; once more for what acts at once instead
    assert off <= 4 * hankel[4:].sum()


def test_noise_gain_is_what_white_noise_shows():
    A = np.array([[-0.05, 0.02], [0.0, -0.3]])
    found = system(A, np.array([[0.05, 0.0], [0.3, -0.2]]), np.array([[1.0, 1.5]]))
    said = response_degC(found, "first-order", np.random.default_rng(0).standard_normal((2, 200_000)), 1.0)
    assert noise_gain(found, 1.0) == pytest.approx(said[500:].std(), rel=0.01)
    slow = system(np.array([[0.0, 1.0], [-1e-10, -2e-5]]), np.array([[1e-5], [1e-10]]), np.eye(1, 2))  # logged hourly
    impulse = response_degC(slow, "first-order", np.eye(1, 2000, 1), 3600.0) - slow.offset
    assert noise_gain(slow, 3600.0) == pytest.approx(np.linalg.norm(impulse), rel=1e-9)


PAIR = np.array([[0.9, 0.2], [-0.1, 0.85]])
SYSTEMS = {
    "one pole": np.array([[0.7]]),
    "real": np.array([[0.9, 0.1, 0.0], [0.05, 0.7, 0.1], [0.0, 0.2, 0.5]]),
    "double": np.array([[0.8, 1.0], [0.0, 0.8]]),
    "pair": PAIR,
    "pair between": np.block([[np.diag([0.5]), np.ones((1, 3))], [np.zeros((3, 1)), np.block(
        [[PAIR, np.ones((2, 1))], [np.zeros((1, 2)), np.full((1, 1), 0.2)]])]]),
}  # fmt: skip


def stepped(A, drive, start):
    x = np.zeros_like(drive)
    x[:, 0] = start
    for k in range(drive.shape[1] - 1):
        x[:, k + 1] = A @ x[:, k] + drive[:, k]
    return x


@pytest.mark.parametrize("name", SYSTEMS)
def test_states_are_those_of_the_recursion(name):
    A = SYSTEMS[name]
    drive, start = (np.random.default_rng(0).standard_normal(shape) for shape in ((len(A), 3, 50), (len(A), 3)))
    found = states(A, drive, start)
    for row in range(3):
        np.testing.assert_allclose(found[:, row], stepped(A, drive[:, row], start[:, row]), atol=1e-12)
