"""The heat balance of devices: C dT/dt = heat in + conduction - convection - radiation - ventilation.

It holds a batch of units of one device: arrays have the shape (batch, nodes), nodes in the device's order; temperatures
are in degC, power in W. Convection follows the difference to the power 1.25, radiation the fourth power; a fan's air
flow is proportional to its speed.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.device import Device

STEFAN_BOLTZMANN_W_M2_K4 = 5.670374419e-8  # CODATA
ZERO_DEGC_K = 273.15
LONGEST_STEP_S = 1.0


class Demand(NamedTuple):
    """What is asked of each device: heat in every node, shape (batch, nodes), and the charger's current, (batch,)."""

    heat_W: Array
    charging_A: Array


class HeatBalance:
    """The equations of a batch of units."""

    def __init__(self, devices: Sequence[Device]) -> None:
        self.devices = tuple(devices)
        one = devices[0]
        self.size = len(one.nodes)
        self.processor = one.index(one.processor.node)
        self.capacitance = np.array([[node.capacitance_J_K for node in each.nodes.values()] for each in devices])
        edges = tuple(one.conductance_W_K)
        self._conductance = np.array([[each.conductance_W_K[edge] for edge in edges] for each in devices])
        ends = [one.pattern(dict(zip(edge.split("-"), (1.0, -1.0)))) for edge in edges]
        self._ends = np.ascontiguousarray(np.reshape(ends, (len(edges), self.size)).T)
        """Nodes by edges: +1 where an edge begins, -1 where it ends."""
        surface = np.array([[node.surface_m2 for node in each.nodes.values()] for each in devices])
        emissivity = np.array([[node.emissivity for node in each.nodes.values()] for each in devices])
        self.convection = np.array([[each.convection_W_m2_K125] for each in devices]) * surface
        """By device and node, in W/K^1.25."""
        self._radiation = emissivity * STEFAN_BOLTZMANN_W_M2_K4 * surface
        governors = [each.processor.governor for each in devices]
        self._low, self._band, self._cut = np.array(
            [(g.low_degC, g.high_degC - g.low_degC, 1.0 - g.floor_frac) if g else (0.0, 1.0, 0.0) for g in governors]
        ).T
        self._batteries = [each.battery for each in devices if each.battery]
        self._cell = one.index(self._batteries[0].node) if self._batteries else 0
        self._volt = np.array([battery.volt_V for battery in self._batteries])
        self._ohm = np.array([battery.ohm for battery in self._batteries])
        self._fan = one.fan
        self._fanned = one.index(one.fan.follows) if one.fan else 0
        self._vents = np.array([each.pattern(each.fan.vents_W_K) for each in devices if each.fan])
        self._power = np.array([_power(each) for each in devices])
        self._charging_A = np.array([activity.charging_A for activity in one.activities.values()])
        self._every = np.arange(len(devices))

    def demand(self, activity: NDArray[np.intp], burst: Array) -> Demand:
        """What the activities (indices), shape (batch,), ask for; ``burst`` scales the processor's part."""
        heat = self._power[self._every, activity]
        heat[:, self.processor] *= burst
        return Demand(heat, self._charging_A[activity])

    def governed_W(self, processor_degC: Array, demanded_W: Array) -> Array:
        """What the governors leave of the demanded power at those processor temperatures, shape (batch,)."""
        way = np.minimum(np.maximum((processor_degC - self._low) / self._band, 0.0), 1.0)
        # a smooth way down: a kink would cost the integration its order
        return demanded_W * (1.0 - self._cut * way * way * (3.0 - 2.0 * way))

    def fan_frac(self, nodes: Array) -> Array:
        """The fans' speeds, shape (batch,)."""
        assert self._fan
        way = (nodes[:, self._fanned] - self._fan.low_degC) / (self._fan.high_degC - self._fan.low_degC)
        way = np.clip(way, 0.0, 1.0)
        return self._fan.least_frac + (1.0 - self._fan.least_frac) * way * way * (3.0 - 2.0 * way)

    def battery_current_A(self, other_W: Array, charging_A: Array) -> Array:
        """Positive into the battery; ``other_W`` is what the rest turns to heat. Zero without a battery."""
        if not self._batteries:
            return np.zeros_like(charging_A)
        return np.where(charging_A > 0.0, charging_A, -other_W / self._volt)

    def battery_ohm(self, battery_degC: Array) -> Array:
        """The cells' resistance, shape (batch,)."""
        cell = self._batteries[0]
        return self._ohm * arrhenius(battery_degC, cell.activation_K, cell.reference_degC)

    def drawn(self, nodes: Array, demand: Demand) -> tuple[Array, Array]:
        """The heat that electrical loads set free in every node, and the battery's current, shape (batch,)."""
        heat = demand.heat_W.copy()
        heat[:, self.processor] = self.governed_W(nodes[:, self.processor], heat[:, self.processor])
        return heat, self.battery_current_A(heat.sum(axis=1), demand.charging_A)

    def heat_in(self, nodes: Array, demand: Demand) -> Array:
        """All the heat that is set free in every node."""
        heat, current_A = self.drawn(nodes, demand)
        if self._batteries:
            heat[:, self._cell] += current_A * current_A * self.battery_ohm(nodes[:, self._cell])
        return heat

    def conducted(self, nodes: Array) -> Array:
        """The heat that flows into every node from its neighbours; over a device it sums to zero."""
        flows: Array = (self._conductance * (nodes @ self._ends)) @ self._ends.T
        return -flows

    def lost(self, nodes: Array, air_degC: Array) -> Array:
        """The heat that every node loses to air and walls at ``air_degC``, shape (batch,)."""
        lost = self.convected(nodes, air_degC) + self.radiated(nodes, air_degC)
        if self._fan:
            lost += self.fan_frac(nodes)[:, None] * self._vents * (nodes - air_degC[:, None])
        return lost

    def convected(self, nodes: Array, air_degC: Array) -> Array:
        """What of it the surfaces lose to the air."""
        difference = nodes - air_degC[:, None]
        return self.convection * difference * np.sqrt(np.sqrt(np.abs(difference)))

    def radiated(self, nodes: Array, air_degC: Array) -> Array:
        """What of it goes to the walls."""
        kelvin, walls = nodes + ZERO_DEGC_K, air_degC + ZERO_DEGC_K
        kelvin *= kelvin
        walls = walls * walls
        return self._radiation * (kelvin * kelvin - (walls * walls)[:, None])

    def rates(self, nodes: Array, air_degC: Array, demand: Demand) -> Array:
        """dT/dt in K/s."""
        return (self.heat_in(nodes, demand) + self.conducted(nodes) - self.lost(nodes, air_degC)) / self.capacitance

    def equilibrium(self, air_degC: Array, demand: Demand) -> Array:
        """The steady state, shape (batch, nodes)."""
        result = np.empty((len(self.devices), self.size))
        known: dict[tuple[int, float, bytes], Array] = {}
        for index, device in enumerate(self.devices):
            key = id(device), float(air_degC[index]), demand.heat_W[index].tobytes()
            if key not in known:
                part = slice(index, index + 1)
                asked = Demand(demand.heat_W[part], demand.charging_A[part])
                start = np.full(self.size, air_degC[index] + 1.0)
                known[key] = steady_state(HeatBalance([device]).rates, start, air_degC[part], asked)
            result[index] = known[key]
        return result


def arrhenius(temp_degC: Array, activation_K: float, reference_degC: float) -> Array:
    """A resistance that grows in the cold, over that at the reference."""
    return np.exp(activation_K * (1.0 / (temp_degC + ZERO_DEGC_K) - 1.0 / (reference_degC + ZERO_DEGC_K)))


Rates = Callable[[Array, Array, Demand], Array]
"""dT/dt in K/s, shape (batch, ...), of the state, the air in degC, shape (batch,), and the demand."""


def steady_state(
    rates: Rates, start: Array, air_degC: Array, demand: Demand, free: slice | NDArray[np.bool_] = slice(None)
) -> Array:
    """The state of one device at which nothing changes any more, shape (states,); only ``free`` states may change."""

    def change(values: Array) -> Array:
        state = start.copy()
        state[free] = values
        return rates(state[None], air_degC, demand)[0, free]

    result = start.copy()
    result[free] = root(change, start[free], method="hybr", tol=1e-12).x
    if np.abs(change(result[free])).max() > 1e-8:
        problem = f"there is no thermal equilibrium at {air_degC[0]:g} degC"
        raise refuse("simulation", "", problem, "correct the device's numbers, or hide less")
    return result


def advanced(rates: Rates, state: Array, demand: Demand, air_degC: tuple[Array, Array], period_s: float) -> Array:
    """The state one sample later by classical Runge-Kutta steps, while the air goes straight from one to the other."""
    now, slope_K_s = air_degC[0], (air_degC[1] - air_degC[0]) / period_s
    substeps = math.ceil(period_s / LONGEST_STEP_S)
    step_s = period_s / substeps
    half_s = 0.5 * step_s
    for start_s in (substep * step_s for substep in range(substeps)):
        begin, middle, end = (now + slope_K_s * (start_s + later_s) for later_s in (0.0, half_s, step_s))
        k1 = rates(state, begin, demand)
        k2 = rates(state + half_s * k1, middle, demand)
        k3 = rates(state + half_s * k2, middle, demand)
        k4 = rates(state + step_s * k3, end, demand)
        state = state + (step_s / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
    return state


def _power(device: Device) -> Array:
    """Heat by activity and node; what an activity does not name is as in the first one."""
    idle = device.activities[device.idle].heat_W
    return np.array([device.pattern({**idle, **activity.heat_W}) for activity in device.activities.values()])
