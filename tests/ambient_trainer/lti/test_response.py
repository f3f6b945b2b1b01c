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
def test_states_and_their_answers_are_those_of_the_recursion(name):
    A = SYSTEMS[name]
    upper, basis = schur(A)
    random = np.random.default_rng(0)
    drive, C, signals = (
        random.standard_normal((len(A), 50)),
        random.standard_normal(len(A)),
        random.normal(size=(3, 40)),
    )
    np.testing.assert_allclose(basis @ states_from_rest(upper, basis.T @ drive), stepped(A, drive), atol=1e-12)
    found = responses_of_output(upper, C @ basis, signals)
    for state in range(len(A)):
        for index, signal in enumerate(signals):
            np.testing.assert_allclose(found[state, index], C @ stepped(A, basis[:, [state]] * signal), atol=1e-12)
