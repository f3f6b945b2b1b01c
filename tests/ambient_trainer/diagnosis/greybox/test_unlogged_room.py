"""Beside a room that was not logged, and stands for a number, nothing is named that another room does as well."""

import numpy as np
from scipy.integrate import solve_ivp

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import Cause

TIME_S = np.arange(0.0, 9000.0, 10.0)


def in_a_room(flow_W, draw, start_degC, time_s=TIME_S, columns=()) -> Trace:
    """Nodes that take up ``flow_W(time, degC)`` in a room that is said to have 25 degC all the time."""
    capacitance_J_K = np.array([120.0, 900.0])[: len(start_degC)]

    def slope(now_s, degC):
        return flow_W(now_s, degC) / capacitance_J_K

    solved = solve_ivp(slope, (0.0, time_s[-1]), start_degC, t_eval=time_s, max_step=20.0)
    board = solved.y[0] + 0.05 * draw.standard_normal(len(time_s))
    return Trace("room", time_s, {"board_degC": board, "ambient_degC": np.full(len(time_s), 25.0), **dict(columns)})


def test_evaporation_is_a_loss_that_bends(circuit, seed):
    """Hot water in an open vessel, and the room is a few degrees off; a slow body does nearly the same to one curve."""
    draw = np.random.default_rng(seed)
    room, evaporates = 25.0 + draw.uniform(-2.0, 2.0), draw.uniform(0.02, 0.04)

    def flow_W(_, degC):
        vapour_hPa = 6.112 * np.exp(17.62 * degC / (243.12 + degC))  # Magnus
        return -0.05 * (degC - room) - evaporates * (vapour_hPa - 15.0)

    verdict = diagnose(circuit, [in_a_room(flow_W, draw, [draw.uniform(75.0, 88.0)], TIME_S / 10)]).verdict
    assert Cause("convection_law", "board", None) in (verdict.cause, *verdict.indistinguishable_from), seed
    assert verdict.confidence < 0.7, seed


def test_a_heater_in_the_log_is_named_beside_a_slow_body(circuit, seed):
    """A controller's pulses into a board with a body slower than the log: the body may be the room, the heater not."""
    draw = np.random.default_rng(seed)
    on, heat_W = np.repeat(draw.random(90) < 0.4, 10).astype(float), draw.uniform(3.0, 6.0)

    def flow_W(now_s, state):
        board, body = state
        between = 0.3 * (body - board)
        return np.array([heat_W * np.interp(now_s, TIME_S, on) - 0.05 * (board - 25.0) + between, -between])

    found = diagnose(circuit, [in_a_room(flow_W, draw, [25.0, 25.0], columns={"heater_on": on})])
    assert (found.verdict_cause.name, found.verdict_cause.signal) == ("heat_source", "heater_on"), seed
