"""The integration against an adaptive solver, the heat balance to the last joule, the equilibrium against waiting."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.simulation import constants as c
from ambient_trainer.simulation.constants import LOADS, Activity
from ambient_trainer.simulation.heat import (
    CAPACITANCE,
    N,
    battery_current_A,
    equilibrium,
    heat_in,
    heat_lost,
    node_rates,
    rates,
    rk4_step,
    soc_power_W,
)
from ambient_trainer.simulation.phone import LONGEST_STEP_S, integrate

_SOC = c.NODES.index("soc")


def _solved(start, air_degC, loads, period_s):
    """The same by an adaptive solver of order 8 that starts anew at every sample."""
    states = [start]
    for k, load in enumerate(loads[:-1]):
        slope = (air_degC[k + 1] - air_degC[k]) / period_s

        def derivative(t, x, air=air_degC[k], slope=slope, load=load):
            return rates(x, air + slope * t, load)

        states.append(
            solve_ivp(derivative, (0, period_s), states[-1], method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
        )
    return np.array(states)


@pytest.mark.parametrize("period_s", [0.25, 1.0, 7.0])
def test_integration_agrees_with_an_adaptive_solver(period_s):
    count = int(140 / period_s)
    loads = [LOADS[activity] for activity in (Activity.CPU_100, Activity.CHARGING) for _ in range(count // 2)]
    air_degC = 20 + np.cumsum(np.random.default_rng(1).normal(0, 0.1, len(loads)))
    start = equilibrium(20.0, LOADS[Activity.IDLE])
    ours = integrate(start, air_degC, loads, period_s)
    theirs = _solved(start, air_degC, loads, period_s)
    assert theirs[:, _SOC].max() > c.GOVERNOR_DEGC[0] + 1  # the governor was at work
    errors_K = np.abs(ours - theirs).max(axis=0)
    assert errors_K.max() < 1e-3  # the die for a moment, as the governor steps in: a hundredth of what its sensor reads
    assert np.delete(errors_K, [_SOC, N + c.SENSORS.index("soc")]).max() < 1e-5


def test_halving_the_step_divides_a_smooth_runs_error_by_sixteen():
    load = LOADS[Activity.CPU_50]._replace(soc_W=2.0)  # stays below the governor
    start = equilibrium(20.0, LOADS[Activity.IDLE])

    def derivative(_, x):
        return rates(x, 20.0, load)

    exact = solve_ivp(derivative, (0, 16), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]

    def error(step_s):
        state = start
        for _ in range(round(16 / step_s)):
            state = rk4_step(derivative, 0.0, state, step_s)
        return np.abs(state - exact).max()

    assert 12 < error(1.0) / error(0.5) < 21
    assert error(LONGEST_STEP_S) < 1e-5


@pytest.mark.parametrize("activity", list(Activity))
@pytest.mark.parametrize("air_degC", [-10.0, 50.0])
def test_heat_in_is_heat_stored_plus_heat_lost(activity, air_degC):
    load = LOADS[activity]

    def derivative(t, x):
        nodes, air = x[:N], air_degC + 0.05 * t
        return np.concatenate([node_rates(nodes, air, load), [heat_in(nodes, load).sum(), heat_lost(nodes, air).sum()]])

    start = equilibrium(air_degC, LOADS[Activity.IDLE])[:N]
    state = np.concatenate([start, [0.0, 0.0]])
    for k in range(1200):
        state = rk4_step(derivative, 0.5 * k, state, 0.5)
    taken_J, lost_J = state[N:]
    stored_J = float(CAPACITANCE @ (state[:N] - start))
    assert taken_J == pytest.approx(stored_J + lost_J, rel=1e-9)
    assert taken_J > 30.0


@pytest.mark.parametrize("air_degC", [-10.0, 20.0, 50.0])
@pytest.mark.parametrize("activity", [Activity.IDLE, Activity.CPU_50, Activity.CPU_100, Activity.CHARGING])
def test_equilibrium_is_what_waiting_leads_to(activity, air_degC):
    load = LOADS[activity]
    found = solve_ivp(
        lambda _, x: rates(x, air_degC, load), (0, 40_000), np.full(13, air_degC), method="LSODA", rtol=1e-10, atol=1e-9
    ).y[:, -1]
    assert equilibrium(air_degC, load) == pytest.approx(found, abs=1e-5)


def test_a_body_without_power_takes_the_airs_temperature():
    off = LOADS[Activity.IDLE]._replace(soc_W=0.0, board_W=0.0, display_W=0.0)
    assert equilibrium(-3.0, off) == pytest.approx(np.full(13, -3.0), abs=1e-6)


def test_convection_grows_with_the_power_of_five_quarters():
    nodes = np.full(N, 20.0)
    radiated = c.EMISSIVITY * 5.670374419e-8 * ((20 + 273.15) ** 4 - np.array([4 + 273.15, 19 + 273.15]) ** 4)
    display = c.NODES.index("display")
    lost = np.array([heat_lost(nodes, air)[display] for air in (4.0, 19.0)]) / c.SURFACE_M2["display"] - radiated
    assert lost[0] / lost[1] == pytest.approx(16**1.25)


def test_the_governor_spares_a_hot_die():
    load = LOADS[Activity.CPU_100]
    low, high = c.GOVERNOR_DEGC
    assert soc_power_W(low, load) == load.soc_W
    assert soc_power_W((low + high) / 2, load) == pytest.approx(load.soc_W * (1 + c.GOVERNOR_FLOOR) / 2)
    assert soc_power_W(120.0, load) == pytest.approx(c.GOVERNOR_FLOOR * load.soc_W)
    for air_degC in (-10.0, 20.0, 50.0):
        assert 85.0 < equilibrium(air_degC, load)[_SOC] < 95.0


def test_the_batterys_heat_is_its_current_squared_times_its_resistance():
    charging, idle = LOADS[Activity.CHARGING], LOADS[Activity.IDLE]
    battery = c.NODES.index("battery")
    nodes = np.full(N, 20.0)
    assert heat_in(nodes, charging)[battery] == pytest.approx(3.0**2 * 0.08)
    assert battery_current_A(0.08, charging) == 3.0
    assert battery_current_A(idle.soc_W, idle) == pytest.approx(-0.13 / 3.85)
    assert heat_in(nodes, idle)[battery] == pytest.approx((0.13 / 3.85) ** 2 * 0.08)
