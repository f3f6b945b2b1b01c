"""Array responses are those of the recursion, sample by sample."""

import numpy as np
import pytest

from ambient_trainer.lti.response import states

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
