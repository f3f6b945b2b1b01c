"""What hidden effects add to the heat balance of a batch of devices: heat, changed losses, bodies, conductances.

A conductance takes from one side what it gives to the other; every other term is heat into a node.
Coefficients change at samples and hold until the next.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.heat import Demand, HeatBalance, Rates, arrhenius, steady_state

AIR = "ambient air"
_DRAUGHT_K = 15.0
_OHM_ACTIVATION_K, _OHM_REFERENCE_DEGC = 2000.0, 25.0  # chosen, as for a lithium-ion cell
_APART_S = 120.0  # how fast a body that is not attached follows the air; chosen
_LEAST_LOSS = 0.02
"""Of convection and radiation, whatever covers a surface."""


def _draught(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    """A draught that sets in with the difference: like convection at 15 K, nearly nothing below 5 K."""
    squared = ((nodes - air_degC[:, None]) / _DRAUGHT_K) ** 2
    return -balance.convected(nodes, air_degC) * 2.0 * squared / (1.0 + squared)


TERMS: dict[str, Callable[[Array, Array, HeatBalance], Array]] = {
    "steady": lambda nodes, air_degC, balance: np.ones_like(nodes),
    "ohmic": lambda nodes, air_degC, balance: arrhenius(nodes, _OHM_ACTIVATION_K, _OHM_REFERENCE_DEGC),
    "convected": lambda nodes, air_degC, balance: -balance.convected(nodes, air_degC),
    "radiated": lambda nodes, air_degC, balance: -balance.radiated(nodes, air_degC),
    # forced convection is proportional to the difference, where the device's own is not: equal at 10 K
    "blown": lambda nodes, air_degC, balance: -balance.convection * 10.0**0.25 * (nodes - air_degC[:, None]),
    "draught": _draught,
}
"""Heat into every node, for a coefficient of 1, of nodes, shape (m, nodes), in air, shape (m,)."""
_COVERING = ("convected", "radiated")


@dataclass(frozen=True)
class Term:
    """Heat ``TERMS[kind]`` times ``course``, shape (n,), times ``pattern``, shape (nodes,)."""

    kind: str
    course: Array
    pattern: Array


@dataclass(frozen=True)
class Body:
    """Something beside the device; of infinite capacity it keeps its temperature. None: it starts at the air's."""

    name: str
    capacity_J_K: float
    start_degC: float | None = None


@dataclass(frozen=True)
class Link:
    """A conductance, shape (n,), between two of: a node of the device, a body's name, ``AIR``."""

    one: str
    other: str
    conductance_W_K: Array


class Added(NamedTuple):
    """What one effect adds to one run."""

    terms: tuple[Term, ...] = ()
    bodies: tuple[Body, ...] = ()
    links: tuple[Link, ...] = ()


def apart(attached: Array, capacity_J_K: float) -> Array:
    """The conductance to the air of a body that is ``attached`` by so much, 0 to 1."""
    return np.maximum(1.0 - attached, 0.0) * capacity_J_K / _APART_S


def together(added: Sequence[Added]) -> Added:
    """What several effects add to one run."""
    return Added(*(tuple(chain.from_iterable(parts)) for parts in zip(*added)))


class Additions:
    """What is added to every run of a batch, ``added[i]`` to the device ``i`` of ``balance``."""

    def __init__(self, balance: HeatBalance, added: Sequence[Added]) -> None:
        self.balance = balance
        self._added = tuple(added)
        bodies = max((len(each.bodies) for each in added), default=0)
        size = balance.size
        self.width = size + bodies
        self.capacitance = np.full((len(added), self.width), math.inf)
        self.capacitance[:, :size] = balance.capacitance
        for row, each in zip(self.capacitance, added):
            row[size : size + len(each.bodies)] = [body.capacity_J_K for body in each.bodies]
        found = {kind: _coefficients(kind, added, size) for kind in TERMS}
        self._kinds = {kind: coefficients for kind, coefficients in found.items() if coefficients is not None}
        self._ends, self._conductances = _linked(added, tuple(balance.devices[0].nodes), self.width)

    def coefficients(self, k: int) -> dict[str, Array]:
        """By kind of term its coefficients from sample ``k`` to the next, shape (batch, nodes)."""
        return {kind: of_all[min(k, len(of_all) - 1)] for kind, of_all in self._kinds.items()}

    def rates_during(self, k: int) -> Rates:
        """dT/dt in K/s from sample ``k`` to the next, of states of the shape (batch, width)."""
        coefficients = self.coefficients(k)
        size, balance = self.balance.size, self.balance

        def rates(state: Array, air_degC: Array, demand: Demand) -> Array:
            nodes = np.ascontiguousarray(state[:, :size])
            own = balance.heat_in(nodes, demand) + balance.conducted(nodes) - balance.lost(nodes, air_degC)
            added = np.zeros_like(nodes)
            for kind, coefficient in coefficients.items():
                added += coefficient * TERMS[kind](nodes, air_degC, balance)
            heat = np.zeros_like(state)
            heat[:, :size] = own + added
            if self._ends.shape[2]:
                heat += self.linked(k, state, air_degC)[:, :-1]
            return heat / self.capacitance

        return rates

    def linked(self, k: int, state: Array, air_degC: Array) -> Array:
        """The heat through the links into every node, body and, last, the air, shape (batch, width + 1)."""
        temperatures = np.concatenate([state, air_degC[:, None]], axis=1)
        conductance = self._conductances[min(k, len(self._conductances) - 1)]
        flows = conductance * np.matmul(temperatures[:, None, :], self._ends)[:, 0]
        into: Array = -np.matmul(self._ends, flows[:, :, None])[:, :, 0]
        return into

    def start(self, nodes: Array, air_degC: Array, demand: Demand) -> Array:
        """The state to start from, shape (batch, width), with the devices' own steady state, shape (batch, nodes).

        Where an effect lasts since ever, it is the steady state with it.
        """
        size = self.balance.size
        state = np.repeat(air_degC[:, None], self.width, axis=1)
        state[:, :size] = nodes
        for index, each in enumerate(self._added):
            for place, body in enumerate(each.bodies, start=size):
                state[index, place] = state[index, place] if body.start_degC is None else body.start_degC
            if any(term.course[0] for term in each.terms) or each.links:
                asked = Demand(demand.heat_W[index : index + 1], demand.charging_A[index : index + 1])
                one = Additions(HeatBalance([self.balance.devices[index]]), [each])
                begun, air = state[index, : one.width], air_degC[index : index + 1]
                rates, free = one.rates_during(0), np.isfinite(one.capacitance[0])
                state[index, : one.width] = steady_state(rates, begun, air, asked, free)
        return state


def _coefficients(kind: str, added: Sequence[Added], size: int) -> Array | None:
    """Of one kind of term by sample, shape (n, batch, nodes), zero after a run's end; None where there is none."""
    terms = [(index, term) for index, each in enumerate(added) for term in each.terms if term.kind == kind]
    if not terms:
        return None
    result = np.zeros((max(len(term.course) for _, term in terms), len(added), size))
    for index, term in terms:
        result[: len(term.course), index] += term.course[:, None] * term.pattern
    return np.maximum(result, _LEAST_LOSS - 1.0) if kind in _COVERING else result


def _linked(added: Sequence[Added], nodes: Sequence[str], width: int) -> tuple[Array, Array]:
    """Ends, shape (batch, width + 1, links), and conductances, shape (n, batch, links); none after a run's end."""
    most = max((len(each.links) for each in added), default=0)
    count = max((len(link.conductance_W_K) for each in added for link in each.links), default=1)
    ends = np.zeros((len(added), width + 1, most))
    conductances = np.zeros((count, len(added), most))
    for index, each in enumerate(added):
        names = (*nodes, *(body.name for body in each.bodies))
        places = {AIR: width, **{name: place for place, name in enumerate(names)}}
        for number, link in enumerate(each.links):
            ends[index, places[link.one], number] = 1.0
            ends[index, places[link.other], number] = -1.0
            conductances[: len(link.conductance_W_K), index, number] = link.conductance_W_K
    return ends, conductances
