"""Small circuits with known parameters, data made of them by integration, and problems solved the slow way."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.lti.statespace import StateSpace

CIRCUITS = Path(__file__).parents[1] / "data" / "circuits"


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    """Four BLAS threads make the algebra of 5 x 5 matrices many times slower."""
    with threadpool_limits(1):
        yield


@pytest.fixture
def forward():
    """The circuit whose nodes are all measured; its initial values are the truth."""
    return load_circuit(str(CIRCUITS / "three_nodes.yaml"))


@pytest.fixture
def rise():
    """A circuit in rise form with known heat capacities; its initial values are the truth."""
    return load_circuit(str(CIRCUITS / "rise.yaml"))


def run_loop(discrete: StateSpace, inputs: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The outputs (q, N) by the plain recursion, one sample at a time."""
    outputs = []
    for u in inputs.T:
        outputs.append(discrete.C @ x + discrete.D @ u + discrete.offset)
        x = discrete.A @ x + discrete.B @ u
    return np.array(outputs).T


@pytest.fixture
def simulated() -> Callable[..., np.ndarray]:
    return run_loop


@pytest.fixture
def at_rest() -> Callable[[StateSpace, np.ndarray], np.ndarray]:
    """The state of a discrete system that has seen ``u`` for ever."""
    return lambda discrete, u: np.linalg.solve(np.eye(len(discrete.A)) - discrete.A, discrete.B @ u)
