"""Small circuits with known parameters, data made of them by integration, and problems solved the slow way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from ambient_trainer.circuits.assemble import StateSpace
from ambient_trainer.circuits.schema import load_circuit, parse_circuit

THREE_NODES = Path(__file__).parents[2] / "data" / "circuits" / "three_nodes.yaml"

RISE = """
format: ambient-circuit
version: 1
name: rise
about: Two nodes beside a hot one, capacitances known
form: rise
nodes:
  board: {capacitance: C_board, sensor: board}
  shell: {capacitance: C_shell, sensor: shell}
  chip: {sensor: chip}
edges:
  - {between: [chip, board], resistance: R_chip_board}
  - {between: [board, shell], resistance: R_board_shell}
  - {between: [board, ambient], resistance: R_board}
  - {between: [shell, ambient], resistance: R_shell}
outputs:
  ambient: {states: parallel, inputs: {board_degC: w1, shell_degC: w2}}
parameters:
  C_board: {unit: J/K, initial: 12, free: false}
  C_shell: {unit: J/K, initial: 30, free: false}
  R_chip_board: {unit: K/W, initial: 4}
  R_board_shell: {unit: K/W, initial: 7}
  R_board: {unit: K/W, initial: 15}
  R_shell: {unit: K/W, initial: 9}
  w1: {unit: "1", initial: 0.4, min: 0, max: 1}
  w2: {unit: "1", initial: 0.6, min: 0, max: 1}
"""


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    """Four BLAS threads make the algebra of 5 x 5 matrices many times slower."""
    with threadpool_limits(1):
        yield


@pytest.fixture
def forward():
    """The circuit whose nodes are all measured; its initial values are the truth."""
    return load_circuit(str(THREE_NODES))


@pytest.fixture
def rise():
    """A circuit in rise form with known heat capacities; its initial values are the truth."""
    return parse_circuit(RISE, "rise.yaml")


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
