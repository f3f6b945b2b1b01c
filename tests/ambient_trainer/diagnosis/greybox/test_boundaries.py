"""Second boundaries: water that flows in, whose temperature is logged, and a wall that stays as it is, which is not."""

import numpy as np
import pytest

from ambient_trainer.diagnosis.diagnose import diagnose, learn_known_good
from ambient_trainer.diagnosis.greybox.mechanisms.path import Path
from ambient_trainer.diagnosis.result import Cause

from .test_unlogged_room import TIME_S, in_a_room


def test_a_flow_carries_what_comes_in(circuit, seed):
    draw = np.random.default_rng(seed)
    flow_L_min = np.repeat(draw.uniform(0, 2, 30), 30)
    inlet_degC = 40 + 10 * np.sin(TIME_S / draw.uniform(500, 900))

    def flow_W(now_s, degC):
        flow, inlet = (np.interp(now_s, TIME_S, each) for each in (flow_L_min, inlet_degC))
        return 0.2 * flow * (inlet - degC) - 0.1 * (degC - 25.0)

    columns = {"flow_L_min": flow_L_min, "water_in_degC": inlet_degC}
    step = diagnose(circuit, [in_a_room(flow_W, draw, [25.0], columns=columns)]).verdict
    assert step.cause == Cause("path", "board-water_in", "flow_L_min"), seed
    assert step.confidence > 0.9, seed


def test_a_wall_that_stays_as_it_is_is_a_slow_body(circuit, simulated, seed):
    """Its temperature is another one than the air's, which no constant heat replaces: it takes part of each swing."""
    draw = np.random.default_rng(seed)
    wall_degC, between_W_K = draw.uniform(5, 12), draw.uniform(0.2, 0.4)
    trace = simulated(seed, heat_W=lambda _, degC: between_W_K * (wall_degC - degC))
    found, known = diagnose(circuit, [trace]), learn_known_good(circuit, [trace])
    mass = next(each for each in found.steps if each.cause.name == "thermal_mass")
    assert "a constant temperature does the same" in mass.magnitude.qualifier, seed
    assert 0.5 < mass.confidence <= 0.6, seed
    assert not any(each.slow for each in known.model.mechanisms), f"takes up what changes later: {seed}"


@pytest.mark.parametrize(("other", "responds"), [("water_in", False), ("room", False), ("lid", True)])
def test_what_is_given_from_outside_answers_to_nothing(other, responds):
    assert Path((), (), ends=("board", other), logged=(f"{other}_degC",)).responds == responds
