"""A small device with known constants, its log made by integration, and an observer file for it that fits fast."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.data.trace import Trace

from ...conftest import CIRCUITS

PERIOD_S = 5.0

TRUTH = {
    "C_chip": 2.4,
    "C_board": 19.0,
    "C_shell": 48.0,
    "R_chip_board": 12.5,
    "R_board_shell": 4.0,
    "R_shell_ambient": 5.0,
    "lag_chip": 5.0,
    "lag_board": 9.0,
    "lag_shell": 9.0,
    "share_board": 0.8,
    "rho": 0.3,
}


def integrated(
    truth: dict[str, float], air: np.ndarray, chip_W: np.ndarray, board_W: np.ndarray, shell_W: np.ndarray
) -> np.ndarray:
    """What the sensors of the brick read, (3, N), by an integrator that knows nothing of modes and iterations."""
    time_s = np.arange(len(air)) * PERIOD_S
    chip, board, shell, lags = truth["C_chip"], truth["C_board"], truth["C_shell"], ("chip", "board", "shell")

    def rates(now: float, T: np.ndarray) -> list[float]:
        outside, p, q, r = (np.interp(now, time_s, each) for each in (air, chip_W, board_W, shell_W))
        up, across = (T[0] - T[1]) / truth["R_chip_board"], (T[1] - T[2]) / truth["R_board_shell"]
        rise, mean_K = T[2] - outside, (T[2] + outside) / 2 + 273.15
        bent = (1 - truth["rho"]) * ((rise**2 + 0.25) / 25) ** 0.125 + truth["rho"] * (mean_K / 293.15) ** 3
        loss = rise / truth["R_shell_ambient"] * bent
        nodes = [(p - up) / chip, (q + up - across) / board, (r + across - loss) / shell]
        return [*nodes, *((T[i] - T[3 + i]) / truth[f"lag_{name}"] for i, name in enumerate(lags))]

    # equilibrium: long at the first sample
    settled = solve_ivp(lambda _, T: rates(0.0, T), (0, 2e4), np.full(6, air[0]), method="LSODA", rtol=1e-9, atol=1e-9)
    found = solve_ivp(
        rates, (0, time_s[-1]), settled.y[:, -1], method="LSODA", t_eval=time_s, rtol=1e-7, atol=1e-7, max_step=20.0
    )
    return found.y[3:]


def logged(seed: int, hours: float, unlogged_W: float = 0.0) -> Trace:
    """A log of the brick: set points, bursts of work, noise of 0.02 degC; ``unlogged_W`` into the board at times."""
    random = np.random.default_rng(seed)
    count = int(hours * 3600 / PERIOD_S)
    time_s = np.arange(count) * PERIOD_S
    air, load, extra = np.empty(count), np.zeros(count), np.zeros(count)
    now = wanted = 20.0
    for k in range(count):
        if k % 500 == 0:
            wanted = random.uniform(0, 40)
        now += np.clip(wanted - now, -0.2, 0.2)
        air[k] = now
    for start in range(200, count, 600):
        load[start : start + 150] = random.choice([0.5, 1.0])
    for start in range(500, count, 700):
        extra[start : start + 300] = unlogged_W
    air += 0.3 * np.sin(2 * np.pi * time_s / 700) + 0.03 * random.standard_normal(count)
    chip_W = 0.1 + 1.5 * load
    rest_W = 0.05 + 0.3 * load
    sensors = integrated(TRUTH, air, chip_W, TRUTH["share_board"] * rest_W + extra, np.zeros(count))
    columns = {
        **{
            f"{name}_degC": row + 0.02 * random.standard_normal(count)
            for name, row in zip(("chip", "board", "shell"), sensors)
        },
        "ambient_degC": air,
        "chip_power_W": chip_W,
        "battery_current_A": -(chip_W + rest_W) / 4.0,
        "cpu_load_frac": load,
    }
    return Trace(f"brick {seed}", time_s, columns)


@pytest.fixture(scope="session")
def brick_log() -> Trace:
    """Six hours of a brick whose constants are :data:`TRUTH`."""
    return logged(1, 6.0)


@pytest.fixture(scope="session")
def observer_file() -> str:
    """The observer of the brick, beside its circuit."""
    return str(CIRCUITS / "brick_observer.yaml")
