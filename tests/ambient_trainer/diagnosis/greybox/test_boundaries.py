"""Second boundaries: water that flows in, whose temperature is logged, and a wall that stays as it is, which is not."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose, learn_known_good
from ambient_trainer.diagnosis.greybox.mechanisms.path import Path
from ambient_trainer.diagnosis.result import Cause

from .test_places import PAIR
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
    assert step.magnitude.unit == "W/K per L/min"
    assert step.confidence > 0.9, seed


def two_bodies(slope_K_s, seed, **columns):
    """``fast`` and ``slow``, whose slopes follow from the time and their temperatures; logged with noise."""
    draw = np.random.default_rng(seed)
    solved = solve_ivp(slope_K_s, (0.0, TIME_S[-1]), [25.0, 25.0], t_eval=TIME_S, max_step=20.0)
    fast, slow = solved.y + draw.normal(0, 0.05, solved.y.shape)
    return Trace("two bodies", TIME_S, {"fast_degC": fast, "slow_degC": slow, **columns})


@pytest.mark.slow
def test_water_that_flows_past_several_bodies_warms_them_all(seed):
    """And a pump's current that follows the water heats none of them."""
    draw = np.random.default_rng(seed)
    inlet_degC = 40 + 12 * np.sin(TIME_S / draw.uniform(500, 900)) + np.repeat(draw.normal(0, 4, 30), 30)
    joined_W_K = draw.uniform(0.4, 1.2, 2)

    def slope(now_s, degC):
        apart = np.interp(now_s, TIME_S, inlet_degC) - degC
        return (joined_W_K * apart * (1 + 0.01 * np.abs(apart)) - 0.2 * (degC - 25.0)) / np.array([120.0, 600.0])

    columns = {"water_in_degC": inlet_degC, "pump_A": 0.05 * (inlet_degC - 20) + draw.normal(0, 0.05, len(TIME_S))}
    found = diagnose(PAIR, [two_bodies(slope, seed, ambient_degC=np.full(len(TIME_S), 25.0), **columns)])
    assert found.verdict_cause == Cause("path", ("fast-water_in", "slow-water_in"), None), seed


def beside_a_reference(draw, seed, off_degC):
    """What warms two bodies is the air, which a reference logs as warmer than it is."""
    air_degC = 18 + 8 * np.sin(TIME_S / draw.uniform(700, 1200)) + np.repeat(draw.normal(0, 3, 18), 50)
    loss_W_K = draw.uniform(0.3, 0.9, 2)

    def slope(now_s, degC):
        apart = np.interp(now_s, TIME_S, air_degC) - degC
        return loss_W_K * apart * (1 + 0.004 * np.abs(apart)) / np.array([120.0, 600.0])

    return diagnose(PAIR, [two_bodies(slope, seed, ambient_degC=air_degC + off_degC)]).verdict


def test_a_reference_in_the_sun_is_one_offset_and_no_heat_at_each_body(seed):
    draw = np.random.default_rng(seed)
    off_degC = draw.uniform(3, 7)
    step = beside_a_reference(draw, seed, off_degC)
    assert step.cause == Cause("sensor_bias", "ambient", None), seed
    assert step.magnitude.value == pytest.approx(off_degC, rel=0.2), seed
    assert step.confidence <= 0.6, seed
    assert Cause("heat_source", None, None) in step.indistinguishable_from, seed


def test_a_reference_that_is_more_than_ten_degrees_off_measures_something_else(seed):
    """As a solar store's of 25 K did."""
    draw = np.random.default_rng(seed)
    step = beside_a_reference(draw, seed, draw.uniform(13, 17))
    assert step.cause == Cause("heat_source", ("fast", "slow"), None), seed


@pytest.mark.slow
def test_a_wall_that_stays_as_it_is_is_a_slow_body(circuit, simulated, seed):
    """Its temperature is another one than the air's, which no constant heat replaces: it takes part of each swing."""
    draw = np.random.default_rng(seed)
    wall_degC, between_W_K = draw.uniform(5, 12), draw.uniform(0.2, 0.4)
    trace = simulated(seed, heat_W=lambda _, degC: between_W_K * (wall_degC - degC))
    found, known = diagnose(circuit, [trace]), learn_known_good(circuit, [trace])
    mass = next(each for each in found.steps if each.cause.name == "thermal_mass")
    assert "a constant temperature has the same effect" in mass.magnitude.qualifier, seed
    assert 0.5 < mass.confidence <= 0.6, seed
    assert not any(each.slow for each in known.model.mechanisms), f"takes up what changes later: {seed}"


@pytest.mark.parametrize(("other", "responds"), [("water_in", False), ("room", False), ("lid", True)])
def test_what_is_given_from_outside_answers_to_nothing(other, responds):
    assert Path((), (), ends=("board", other), logged=(f"{other}_degC",)).endogenous == responds
