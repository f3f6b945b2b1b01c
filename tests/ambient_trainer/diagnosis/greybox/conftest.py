"""A board in moving air, simulated by scipy's integrator: nothing of it comes from the code that is fitted to it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.model import Number
from ambient_trainer.diagnosis.record import records

from ...conftest import in_air

PERIOD_S, SAMPLES = 30.0, 1200


@pytest.fixture(scope="session")
def circuit():
    return forward(in_air("board", 50, 5))


def heat(driver: str, value: float) -> Heat:
    """Into the board, proportional to a driver."""
    return Heat(("board",), (Number("heat_board", "W", value, scale=abs(value)),), Expression(driver))


def drives(seed: int) -> dict[str, np.ndarray]:
    """Air that wanders by day and hour, wind, sun behind clouds, pulses of a current; humidity does nothing."""
    draw = np.random.default_rng(seed)
    time_s = PERIOD_S * np.arange(SAMPLES)
    day = np.sin(2 * np.pi * time_s / (PERIOD_S * SAMPLES / 3))

    def held(every: int) -> np.ndarray:
        return np.repeat(draw.random(SAMPLES // every + 1), every)[:SAMPLES]

    return {
        "ambient_degC": 20 + 8 * day + 2 * held(100),
        "wind_m_s": 5 * held(40) ** 2,
        "sun_W_m2": 800 * np.maximum(day, 0) * (0.3 + 0.7 * held(15)),
        "current_A": 2 * (held(25) > 0.5) * held(50),
        "humidity_frac": held(60),
    }


def run(seed: int, heat_W=0.0, conductance_W_K=0.4, noise_degC=0.03, capacitance_J_K=120.0, mass=None) -> Trace:
    """``heat_W`` and ``conductance_W_K`` are numbers or functions of the drives at a time and the temperature."""
    columns = drives(seed)
    time_s = PERIOD_S * np.arange(SAMPLES)

    def at(now: float) -> dict[str, float]:
        return {"time_s": now, **{name: float(np.interp(now, time_s, row)) for name, row in columns.items()}}

    def value(what, now: dict[str, float], degC: float) -> float:
        return what(now, degC) if callable(what) else what

    def slope(now_s: float, state: np.ndarray) -> list[float]:
        now, board = at(now_s), state[0]
        flow = value(heat_W, now, board) + value(conductance_W_K, now, board) * (now["ambient_degC"] - board)
        if mass is None:
            return [flow / capacitance_J_K]
        joined, body_J_K = mass
        between = value(joined, now, board)
        inward = between * (state[1] - board)
        # what hangs in the air follows it
        aired = 0.0 if between else (now["ambient_degC"] - state[1]) / 900
        return [(flow + inward) / capacitance_J_K, aired - inward / body_J_K]

    start = [columns["ambient_degC"][0]] * (1 if mass is None else 2)
    solved = solve_ivp(slope, (0, time_s[-1]), start, t_eval=time_s, max_step=PERIOD_S, rtol=1e-6)
    noise = noise_degC * np.random.default_rng(seed + 1).standard_normal(SAMPLES)
    return Trace(f"seed {seed}", time_s, {"board_degC": solved.y[0] + noise, **columns})


@pytest.fixture(scope="session")
def simulated():
    return run


@pytest.fixture(scope="session")
def recorded(circuit):
    """A trace as the records of the circuit."""
    return lambda trace: records(trace, circuit.inputs, ["board_degC"], PERIOD_S)
