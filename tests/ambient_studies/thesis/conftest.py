"""A phone of five first-order nodes: enough for every model of the thesis to have something to fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from threadpoolctl import threadpool_limits

from ambient_trainer.data.trace import Trace

SHARED = Path(__file__).parents[4] / "shared" / "thesis"
PERIOD_S = 5.0

_CAPACITANCE_J_K = np.array([8.0, 20.0, 45.0, 12.0, 30.0])
_SENSORS = ("soc", "flash", "battery", "usb", "display")
_BETWEEN = {(0, 1): 0.25, (0, 2): 0.12, (0, 4): 0.2, (1, 4): 0.05, (2, 3): 0.08, (2, 4): 0.1, (3, 4): 0.02}
_TO_AIR_W_K = np.array([0.0, 0.03, 0.05, 0.09, 0.1])


def phone_run(minutes: float, seed: int) -> Trace:
    """A simulated run: the air steps every 40 minutes or so and is filtered, the SoC is loaded off and on."""
    random = np.random.default_rng(seed)
    count = round(minutes * 60 / PERIOD_S)
    air = np.zeros(count)
    wanted = np.repeat(random.uniform(-10, 50, count // 480 + 1), 480)[:count]
    air[0] = wanted[0]
    for k in range(1, count):
        air[k] = air[k - 1] + (wanted[k] - air[k - 1]) * PERIOD_S / 150
    power = np.repeat(random.choice([0.3, 0.4, 3.0, 1.5], count // 120 + 1), 120)[:count]
    G = np.diag(_TO_AIR_W_K)
    for (a, b), conductance in _BETWEEN.items():
        G[[a, b], [a, b]] += conductance
        G[[a, b], [b, a]] -= conductance
    A = -G / _CAPACITANCE_J_K[:, None]
    drive = np.column_stack([_TO_AIR_W_K, np.eye(5)[0]]) / _CAPACITANCE_J_K[:, None]
    E = expm(A * PERIOD_S)
    held = np.linalg.solve(A, (E - np.eye(5)) @ drive)
    T = np.empty((5, count))
    T[:, 0] = np.linalg.solve(-A, drive @ [air[0], power[0]])
    for k in range(count - 1):
        T[:, k + 1] = E @ T[:, k] + held @ [air[k], power[k]]
    columns = {f"{name}_degC": row + random.normal(0, 0.02, count) for name, row in zip(_SENSORS, T)}
    columns["ambient_degC"] = air
    return Trace("made.csv", np.arange(count) * PERIOD_S, columns)


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    """Four BLAS threads make the algebra of 3 x 3 matrices many times slower."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session")
def training():
    return phone_run(360, seed=1)


@pytest.fixture(scope="session")
def unseen():
    return phone_run(90, seed=2)


@pytest.fixture
def thesis_file():
    """Reads a file of the thesis, where it lies beside the repository."""

    def read(name: str) -> str:
        path = SHARED / name
        if not path.exists():
            pytest.skip(f"{path} is not there")
        return path.read_text(encoding="utf-8")

    return read
