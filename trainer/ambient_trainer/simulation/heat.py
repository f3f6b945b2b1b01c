"""The phone's heat balance: C dT/dt = heat in + conduction - convection - radiation, and the sensors that lag behind.

Temperatures are in degC, power in W. Convection follows the difference to the power 1.25, radiation the fourth power.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from ambient_model.faults import refuse
from ambient_trainer.simulation import constants as c
from ambient_trainer.simulation.constants import Load

Array = NDArray[np.float64]


def _per_node(values: dict[str, float]) -> Array:
    return np.array([values.get(node, 0.0) for node in c.NODES])


def _conduction() -> Array:
    """The symmetric matrix K with heat flowing into the nodes = K T; its rows sum to zero."""
    matrix = np.zeros((len(c.NODES), len(c.NODES)))
    for (one, other), conductance in c.CONDUCTANCE_W_K.items():
        i, j = c.NODES.index(one), c.NODES.index(other)
        matrix[[i, j], [j, i]] += conductance
        matrix[[i, j], [i, j]] -= conductance
    return matrix


CAPACITANCE = _per_node(c.CAPACITANCE_J_K)
_CONDUCTION = _conduction()
_CONVECTION = c.CONVECTION_W_M2_K125 * _per_node(c.SURFACE_M2)
_RADIATION = c.EMISSIVITY * c.STEFAN_BOLTZMANN_W_M2_K4 * _per_node(c.SURFACE_M2)
_SOC = c.NODES.index("soc")
_READ = np.array([c.NODES.index(sensor) for sensor in c.SENSORS])
_LAG_RATE = 1.0 / np.array([c.SENSOR_LAG_S[sensor] for sensor in c.SENSORS])

N = len(c.NODES)


def soc_power_W(soc_degC: float, load: Load) -> float:
    """What the governor leaves of the demanded power at that die temperature."""
    low, high = c.GOVERNOR_DEGC
    way = min(max((soc_degC - low) / (high - low), 0.0), 1.0)
    # a smooth way down: a kink would cost the integration its order
    return load.soc_W * (1.0 - (1.0 - c.GOVERNOR_FLOOR) * way * way * (3.0 - 2.0 * way))


def battery_current_A(soc_W: float, load: Load) -> float:
    """Into the battery is positive, as in Android's ``current_now``."""
    if load.charging_A:
        return load.charging_A
    return -(soc_W + load.board_W + load.flash_W + load.usb_W + load.display_W) / c.BATTERY_V


def heat_in(nodes: Array, load: Load) -> Array:
    """The heat in W that is set free in each of the nodes at the temperatures ``nodes``, shape (7,)."""
    soc_W = soc_power_W(float(nodes[_SOC]), load)
    current = battery_current_A(soc_W, load)
    battery_W = current * current * c.BATTERY_OHM
    return np.array([soc_W, load.board_W, load.flash_W, battery_W, load.usb_W, load.display_W, 0.0])


def heat_lost(nodes: Array, air_degC: float) -> Array:
    """The heat in W that each of the nodes loses to air and walls at ``air_degC``, shape (7,)."""
    difference = nodes - air_degC
    walls_K = air_degC + c.ZERO_DEGC_K
    radiated = ((nodes + c.ZERO_DEGC_K) ** 2) ** 2 - walls_K**4
    return _CONVECTION * difference * np.sqrt(np.sqrt(np.abs(difference))) + _RADIATION * radiated


def node_rates(nodes: Array, air_degC: float, load: Load) -> Array:
    """dT/dt of the nodes in K/s, shape (7,)."""
    rates: Array = (heat_in(nodes, load) + _CONDUCTION @ nodes - heat_lost(nodes, air_degC)) / CAPACITANCE
    return rates


def rates(state: Array, air_degC: float, load: Load) -> Array:
    """d/dt of the whole state in K/s: 7 nodes, 5 lagging sensors, the probe in the air."""
    nodes = state[:N]
    result = np.empty_like(state)
    result[:N] = node_rates(nodes, air_degC, load)
    result[N:-1] = (nodes[_READ] - state[N:-1]) * _LAG_RATE
    result[-1] = (air_degC - state[-1]) / c.PROBE_LAG_S
    return result


def equilibrium(air_degC: float, load: Load) -> Array:
    """The state, shape (13,), in which nothing changes any more."""
    found = root(node_rates, np.full(N, air_degC + 1.0), args=(air_degC, load), method="hybr", tol=1e-12)
    nodes = np.asarray(found.x)
    if np.abs(node_rates(nodes, air_degC, load)).max() > 1e-9:
        raise refuse("simulation", "", f"no thermal equilibrium at {air_degC:g} degC", "correct the constants")
    return np.concatenate([nodes, nodes[_READ], [air_degC]])


def rk4_step(derivative: Callable[[float, Array], Array], start_s: float, state: Array, step_s: float) -> Array:
    """One step of the classical fourth-order Runge-Kutta method."""
    half = 0.5 * step_s
    k1 = derivative(start_s, state)
    k2 = derivative(start_s + half, state + half * k1)
    k3 = derivative(start_s + half, state + half * k2)
    k4 = derivative(start_s + step_s, state + step_s * k3)
    return state + (step_s / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
