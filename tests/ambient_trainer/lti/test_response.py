"""Array responses are those of the recursion, sample by sample."""

import numpy as np
import pytest
from scipy.linalg import schur

from ambient_trainer.lti.response import responses_of_output, states_from_rest

PAIR = np.array([[0.9, 0.2], [-0.1, 0.85]])
SYSTEMS = {
    "one pole": np.array([[0.7]]),
    "real": np.array([[0.9, 0.1, 0.0], [0.05, 0.7, 0.1], [0.0, 0.2, 0.5]]),
    "double": np.array([[0.8, 1.0], [0.0, 0.8]]),
    "pair": PAIR,
    "pair between": np.block([[np.diag([0.5]), np.ones((1, 3))], [np.zeros((3, 1)), np.block(
        [[PAIR, np.ones((2, 1))], [np.zeros((1, 2)), np.full((1, 1), 0.2)]])]]),
}  # fmt: skip


def stepped(A, drive):
    x = np.zeros_like(drive)
    for k in range(drive.shape[1] - 1):
        x[:, k + 1] = A @ x[:, k] + drive[:, k]
    return x


@pytest.mark.parametrize("name", SYSTEMS)
def test_states_are_those_of_the_recursion(name):
    A = SYSTEMS[name]
    drive = np.random.default_rng(0).standard_normal((len(A), 50))
    upper, basis = schur(A)
    found = basis @ states_from_rest(upper, basis.T @ drive)
    np.testing.assert_allclose(found, stepped(A, drive), atol=1e-12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_each_state_answers_to_each_signal(name):
    A = SYSTEMS[name]
    upper, basis = schur(A)
    C = np.random.default_rng(1).standard_normal(len(A))
    signals = np.random.default_rng(2).standard_normal((3, 40))
    found = responses_of_output(upper, C @ basis, signals)
    for state in range(len(A)):
        for index, signal in enumerate(signals):
            drive = basis[:, [state]] * signal
            np.testing.assert_allclose(found[state, index], C @ stepped(A, drive), atol=1e-12)
