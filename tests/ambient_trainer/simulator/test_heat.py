"""The integration against an adaptive solver, the parts of the heat by hand, the equilibrium against waiting."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.heat import HeatBalance
from ambient_trainer.simulator.run import Run, integrate

_PHONE = load_device()
NODES = tuple(_PHONE.nodes)
SOC, _BATTERY, _DISPLAY = (_PHONE.index(node) for node in ("soc", "battery", "display"))
_BALANCE = HeatBalance([_PHONE])


def _demand(activity, count=1):
    return _BALANCE.demand(np.full(count, _PHONE.activity_index([activity])), np.ones(count))


def _solved(run, period_s):
    """The same by an adaptive solver of order 8 that starts anew at every sample."""
    states = [_BALANCE.equilibrium(run.air_degC[:1], _BALANCE.demand(run.activity[:1], np.ones(1)))[0]]
    for k in range(len(run.air_degC) - 1):
        slope = (run.air_degC[k + 1] - run.air_degC[k]) / period_s
        demand = _BALANCE.demand(run.activity[k : k + 1], np.ones(1))

        def derivative(t, x, air=run.air_degC[k], slope=slope, demand=demand):
            return _BALANCE.rates(x[None], np.array([air + slope * t]), demand)[0]

        solved = solve_ivp(derivative, (0, period_s), states[-1], method="DOP853", rtol=1e-10, atol=1e-10)
        states.append(solved.y[:, -1])
    return np.array(states)


@pytest.mark.parametrize("period_s", [1.0, 7.0])
def test_integration_agrees_with_an_adaptive_solver(period_s):
    count = int(150 / period_s)
    activities = [each for each in ("idle", "cpu_100", "charging") for _ in range(count)]
    air_degC = 20 + np.cumsum(np.random.default_rng(1).normal(0, 0.1, len(activities)))
    indices = np.array([_PHONE.activity_index([each]) for each in activities])
    run = Run(_PHONE, air_degC[0], air_degC, indices, np.ones(len(indices)), 0)
    ours = integrate([run], period_s)[0].nodes_degC
    theirs = _solved(run, period_s)
    assert theirs[:, SOC].max() > _PHONE.processor.governor.low_degC + 1  # the governor was at work
    errors_K = np.abs(ours - theirs).max(axis=0)
    assert errors_K.max() < 0.03  # the die for a moment, as the governor steps in: a third of what its sensor reads
    assert np.delete(errors_K, SOC).max() < 5e-4


@pytest.mark.parametrize(("activity", "air_degC"), [("cpu_100", -10.0), ("charging", 50.0), ("camera_4k", 20.0)])
def test_equilibrium_is_what_waiting_leads_to(activity, air_degC):
    demand, air = _demand(activity), np.array([air_degC])

    def rates(_, x):
        return _BALANCE.rates(x[None], air, demand)[0]

    start = np.full(len(NODES), air_degC)
    found = solve_ivp(rates, (0, 40_000), start, method="LSODA", rtol=1e-10, atol=1e-9).y[:, -1]
    assert _BALANCE.equilibrium(air, demand)[0] == pytest.approx(found, abs=1e-5)


def test_convection_grows_with_the_power_of_five_quarters():
    nodes = np.full((1, len(NODES)), 20.0)
    area = _PHONE.nodes["display"].surface_m2
    air_degC = np.array([4.0, 19.0])
    radiated = 0.9 * 5.670374419e-8 * area * ((20 + 273.15) ** 4 - (air_degC + 273.15) ** 4)
    convected = [_BALANCE.lost(nodes, air_degC[k : k + 1])[0, _DISPLAY] - radiated[k] for k in (0, 1)]
    assert convected[0] / convected[1] == pytest.approx(16**1.25)


def test_the_governor_holds_the_die_near_90_degrees():
    phone = _PHONE.processor.governor
    middle = (phone.low_degC + phone.high_degC) / 2
    powers_W = _BALANCE.governed_W(np.array([phone.low_degC, middle, 120.0]), np.full(3, 8.0))
    assert powers_W == pytest.approx([8.0, 8.0 * (1 + phone.floor_frac) / 2, 8.0 * phone.floor_frac])


def test_the_batterys_heat_is_its_current_squared_times_a_resistance_that_grows_in_the_cold():
    nodes = np.full((1, len(NODES)), 25.0)
    charging, idle = _demand("charging"), _demand("idle")
    assert _BALANCE.heat_in(nodes, charging)[0, _BATTERY] == pytest.approx(3.0**2 * 0.08)
    other_W = idle.heat_W.sum(axis=1)
    current_A = _BALANCE.battery_current_A(other_W, idle.charging_A)
    assert current_A == pytest.approx(-other_W / 3.85)
    assert _BALANCE.heat_in(nodes, idle)[0, _BATTERY] == pytest.approx(current_A[0] ** 2 * 0.08)
    warm, cold = _BALANCE.battery_ohm(np.array([25.0])), _BALANCE.battery_ohm(np.array([-10.0]))
    assert warm == pytest.approx([0.08])
    assert cold / warm == pytest.approx(np.exp(2000 * (1 / 263.15 - 1 / 298.15)))
