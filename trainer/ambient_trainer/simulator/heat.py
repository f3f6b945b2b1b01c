"""The heat balance of phones: C dT/dt = heat in + conduction - convection - radiation, for a batch of them at once.

Arrays have the shape (batch, nodes), nodes in the order of ``NODES``; temperatures are in degC, power in W.
Convection follows the difference to the power 1.25, radiation the fourth power.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from ambient_model.faults import refuse
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.constants import NODES, Activity
from ambient_trainer.simulator.device import Phone

Array = NDArray[np.float64]

SOC = NODES.index("soc")
_BATTERY = NODES.index("battery")
_ACTIVITIES = tuple(Activity)


class Demand(NamedTuple):
    """What is asked of each phone: heat in every node, shape (batch, nodes), and the charger's current, (batch,)."""

    heat_W: Array
    charging_A: Array


class HeatBalance:
    """The equations of a batch of phones."""

    def __init__(self, phones: Sequence[Phone]) -> None:
        self.phones = tuple(phones)
        self.capacitance = np.array([_per_node(phone.capacitance_J_K) for phone in phones])
        edges = tuple(phones[0].conductance_W_K)
        self._conductance = np.array([[phone.conductance_W_K[edge] for edge in edges] for phone in phones])
        self._ends = _incidence(edges)
        surface = np.array([_per_node(phone.surface_m2) for phone in phones])
        self.convection = np.array([[phone.convection_W_m2_K125] for phone in phones]) * surface
        """By phone and node, in W/K^1.25."""
        self._radiation = np.array([[phone.emissivity] for phone in phones]) * c.STEFAN_BOLTZMANN_W_M2_K4 * surface
        self._low = np.array([phone.governor_low_degC for phone in phones])
        self._band = np.array([phone.governor_high_degC for phone in phones]) - self._low
        self._cut = 1.0 - np.array([phone.governor_floor_frac for phone in phones])
        self._volt = np.array([phone.battery_V for phone in phones])
        self._ohm = np.array([phone.battery_ohm for phone in phones])
        self._power = np.array([[_power(phone, activity) for activity in _ACTIVITIES] for phone in phones])
        self._every = np.arange(len(phones))

    def demand(self, activity: NDArray[np.intp], burst: Array) -> Demand:
        """What the activities (indices of ``Activity``), shape (batch,), ask for; ``burst`` scales the SoC's part."""
        heat = self._power[self._every, activity]
        heat[:, SOC] *= burst
        return Demand(heat, _CHARGING_A[activity])

    def soc_power_W(self, soc_degC: Array, demanded_W: Array) -> Array:
        """What the governors leave of the demanded power at those die temperatures, shape (batch,)."""
        way = np.clip((soc_degC - self._low) / self._band, 0.0, 1.0)
        # a smooth way down: a kink would cost the integration its order
        return demanded_W * (1.0 - self._cut * way * way * (3.0 - 2.0 * way))

    def battery_current_A(self, other_W: Array, charging_A: Array) -> Array:
        """Into the battery is positive, as in Android's ``current_now``; ``other_W`` is what the rest turns to heat."""
        return np.where(charging_A > 0.0, charging_A, -other_W / self._volt)

    def battery_ohm(self, battery_degC: Array) -> Array:
        """The cells' resistance, which grows in the cold (Arrhenius), shape (batch,)."""
        inverse = 1.0 / (battery_degC + c.ZERO_DEGC_K) - 1.0 / (c.BATTERY_REFERENCE_DEGC + c.ZERO_DEGC_K)
        return self._ohm * np.exp(c.BATTERY_OHM_ACTIVATION_K * inverse)

    def drawn(self, nodes: Array, demand: Demand) -> tuple[Array, Array]:
        """The heat that electrical loads set free in every node, and the battery's current, shape (batch,)."""
        heat = demand.heat_W.copy()
        heat[:, SOC] = self.soc_power_W(nodes[:, SOC], heat[:, SOC])
        return heat, self.battery_current_A(heat.sum(axis=1), demand.charging_A)

    def heat_in(self, nodes: Array, demand: Demand) -> Array:
        """All the heat that is set free in every node."""
        heat, current_A = self.drawn(nodes, demand)
        heat[:, _BATTERY] += current_A * current_A * self.battery_ohm(nodes[:, _BATTERY])
        return heat

    def conducted(self, nodes: Array) -> Array:
        """The heat that flows into every node from its neighbours; over a phone it sums to zero."""
        flows: Array = (self._conductance * (nodes @ self._ends)) @ self._ends.T
        return -flows

    def lost(self, nodes: Array, air_degC: Array) -> Array:
        """The heat that every node loses to air and walls at ``air_degC``, shape (batch,)."""
        return self.convected(nodes, air_degC) + self.radiated(nodes, air_degC)

    def convected(self, nodes: Array, air_degC: Array) -> Array:
        """What of it goes to the air."""
        difference = nodes - air_degC[:, None]
        return self.convection * difference * np.sqrt(np.sqrt(np.abs(difference)))

    def radiated(self, nodes: Array, air_degC: Array) -> Array:
        """What of it goes to the walls."""
        kelvin, walls = nodes + c.ZERO_DEGC_K, air_degC + c.ZERO_DEGC_K
        kelvin *= kelvin
        walls = walls * walls
        return self._radiation * (kelvin * kelvin - (walls * walls)[:, None])

    def rates(self, nodes: Array, air_degC: Array, demand: Demand) -> Array:
        """dT/dt in K/s."""
        heat = self.heat_in(nodes, demand) + self.conducted(nodes) - self.lost(nodes, air_degC)
        return heat / self.capacitance

    def equilibrium(self, air_degC: Array, demand: Demand) -> Array:
        """The temperatures at which nothing changes any more."""
        result = np.empty((len(self.phones), len(NODES)))
        known: dict[tuple[int, float, bytes], Array] = {}
        for index, phone in enumerate(self.phones):
            key = id(phone), float(air_degC[index]), demand.heat_W[index].tobytes()
            if key not in known:
                part = slice(index, index + 1)
                asked = Demand(demand.heat_W[part], demand.charging_A[part])
                known[key] = _resting(HeatBalance([phone]), air_degC[part], asked)
            result[index] = known[key]
        return result


def _resting(one: HeatBalance, air_degC: Array, demand: Demand) -> Array:
    def rates(nodes: Array) -> Array:
        return one.rates(nodes[None], air_degC, demand)[0]

    found = np.asarray(root(rates, np.full(len(NODES), air_degC[0] + 1.0), method="hybr", tol=1e-12).x)
    if np.abs(rates(found)).max() > 1e-9:
        raise refuse("simulation", "", f"no thermal equilibrium at {air_degC[0]:g} degC", "correct the constants")
    return found


def rk4_step(derivative: Callable[[float, Array], Array], start_s: float, state: Array, step_s: float) -> Array:
    """One step of the classical fourth-order Runge-Kutta method."""
    half = 0.5 * step_s
    k1 = derivative(start_s, state)
    k2 = derivative(start_s + half, state + half * k1)
    k3 = derivative(start_s + half, state + half * k2)
    k4 = derivative(start_s + step_s, state + step_s * k3)
    return state + (step_s / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


_CHARGING_A = np.array([c.CHARGING_A.get(activity, 0.0) for activity in _ACTIVITIES])


def _per_node(values: Mapping[str, float]) -> list[float]:
    return [values.get(node, 0.0) for node in NODES]


def _incidence(edges: Sequence[str]) -> Array:
    """Nodes by edges: +1 where an edge begins, -1 where it ends."""
    matrix = np.zeros((len(NODES), len(edges)))
    for index, edge in enumerate(edges):
        one, _, other = edge.partition("-")
        matrix[NODES.index(one), index] = 1.0
        matrix[NODES.index(other), index] = -1.0
    return matrix


def _power(phone: Phone, activity: Activity) -> list[float]:
    """Heat by node while ``activity`` lasts; what it does not name goes on as in idle."""
    return [phone.power_W.get(f"{activity.value}.{node}", phone.power_W.get(f"idle.{node}", 0.0)) for node in NODES]
