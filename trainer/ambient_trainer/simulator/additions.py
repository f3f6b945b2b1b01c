"""What hidden effects add to the heat balance of a batch of phones: heat, changed losses, bodies, conductances.

A conductance takes from the one side what it gives to the other; every other term is heat into a node, known here only.
Coefficients change at samples and hold until the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from ambient_model.faults import refuse
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.constants import NODES
from ambient_trainer.simulator.heat import Demand, HeatBalance

Array = NDArray[np.float64]

AIR = "air"
_PHONE = len(NODES)
_DRAUGHT_K = 15.0
_LEAST_LOSS = 0.02
"""Of convection and radiation, whatever covers a surface."""


def _steady(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    return np.ones_like(nodes)


def _ohmic(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    """What a resistance sets free that falls with temperature as a cell's does."""
    inverse = 1.0 / (nodes + c.ZERO_DEGC_K) - 1.0 / (c.BATTERY_REFERENCE_DEGC + c.ZERO_DEGC_K)
    return np.exp(c.BATTERY_OHM_ACTIVATION_K * inverse)


def _convected(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    return -balance.convected(nodes, air_degC)


def _radiated(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    return -balance.radiated(nodes, air_degC)


def _blown(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    """Forced convection is proportional to the difference, where the phone's own is not: equal at 10 K."""
    return -balance.convection * 10.0**0.25 * (nodes - air_degC[:, None])


def _draught(nodes: Array, air_degC: Array, balance: HeatBalance) -> Array:
    """A draught that sets in with the difference: like convection at 15 K, nearly nothing below 5 K."""
    squared = ((nodes - air_degC[:, None]) / _DRAUGHT_K) ** 2
    return -balance.convected(nodes, air_degC) * 2.0 * squared / (1.0 + squared)


TERMS: dict[str, Callable[[Array, Array, HeatBalance], Array]] = {
    "steady": _steady,
    "ohmic": _ohmic,
    "convected": _convected,
    "radiated": _radiated,
    "blown": _blown,
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
    """Something beside the phone; of infinite capacity it keeps its temperature. None: it starts at the air's."""

    name: str
    capacity_J_K: float
    start_degC: float | None = None


@dataclass(frozen=True)
class Link:
    """A conductance, shape (n,), between two of: a node of the phone, a body's name, ``AIR``."""

    one: str
    other: str
    conductance_W_K: Array


@dataclass(frozen=True)
class Added:
    """What one effect adds to one run."""

    terms: tuple[Term, ...] = ()
    bodies: tuple[Body, ...] = ()
    links: tuple[Link, ...] = ()


def together(added: Sequence[Added]) -> Added:
    """What several effects add to one run."""
    return Added(
        tuple(term for each in added for term in each.terms),
        tuple(body for each in added for body in each.bodies),
        tuple(link for each in added for link in each.links),
    )


class Additions:
    """What is added to every run of a batch, ``added[i]`` to the phone ``i`` of ``balance``."""

    def __init__(self, balance: HeatBalance, added: Sequence[Added]) -> None:
        self.balance = balance
        self._added = tuple(added)
        bodies = max((len(each.bodies) for each in added), default=0)
        self.width = _PHONE + bodies
        self.capacitance = np.full((len(added), self.width), math.inf)
        self.capacitance[:, :_PHONE] = balance.capacitance
        for row, each in zip(self.capacitance, added):
            row[_PHONE : _PHONE + len(each.bodies)] = [body.capacity_J_K for body in each.bodies]
        self._kinds = {kind: _Stacked(kind, added) for kind in TERMS if any(_of(kind, each) for each in added)}
        self._ends, self._conductances = _linked(added, self.width)

    def during(self, k: int) -> Physics:
        """The equations from sample ``k`` to the next."""
        coefficients = {kind: stacked.at(k) for kind, stacked in self._kinds.items()}
        conductance = self._conductances[min(k, len(self._conductances) - 1)]
        return Physics(self.balance, coefficients, self._ends, conductance, self.capacitance)

    def start(self, nodes: Array, air_degC: Array, demand: Demand) -> Array:
        """The state to start from, shape (batch, width), with the phones' own equilibrium, shape (batch, nodes).

        Where an effect lasts since ever, the equilibrium is the one with it.
        """
        state = np.repeat(air_degC[:, None], self.width, axis=1)
        state[:, :_PHONE] = nodes
        for row, each in zip(state, self._added):
            for index, body in enumerate(each.bodies, start=_PHONE):
                row[index] = row[index] if body.start_degC is None else body.start_degC
        for index, each in enumerate(self._added):
            if any(term.course[0] for term in each.terms) or each.links:
                asked = Demand(demand.heat_W[index : index + 1], demand.charging_A[index : index + 1])
                one = Additions(HeatBalance([self.balance.phones[index]]), [each])
                state[index, : one.width] = _resting(one, state[index, : one.width], air_degC[index : index + 1], asked)
        return state


@dataclass(frozen=True)
class Physics:
    """The equations of a batch while nothing is switched; states have the shape (batch, width)."""

    balance: HeatBalance
    coefficients: dict[str, Array]
    """By kind of term, shape (batch, nodes)."""
    ends: Array
    """Links' ends, shape (batch, width + 1, links), the air last: +1 and -1."""
    conductance: Array
    capacitance: Array

    def rates(self, state: Array, air_degC: Array, demand: Demand) -> Array:
        """dT/dt in K/s."""
        nodes = np.ascontiguousarray(state[:, :_PHONE])
        own = self.balance.heat_in(nodes, demand) + self.balance.conducted(nodes) - self.balance.lost(nodes, air_degC)
        heat = np.zeros_like(state)
        heat[:, :_PHONE] = own + self.added(nodes, air_degC)
        if self.ends.shape[2]:
            heat += self.linked(state, air_degC)[:, :-1]
        return heat / self.capacitance

    def added(self, nodes: Array, air_degC: Array) -> Array:
        """The heat into every node but for the links', shape (batch, nodes)."""
        heat = np.zeros_like(nodes)
        for kind, coefficient in self.coefficients.items():
            heat += coefficient * TERMS[kind](nodes, air_degC, self.balance)
        return heat

    def linked(self, state: Array, air_degC: Array) -> Array:
        """The heat through the links into every node, body and, last, the air, shape (batch, width + 1)."""
        temperatures = np.concatenate([state, air_degC[:, None]], axis=1)
        flows = self.conductance * np.matmul(temperatures[:, None, :], self.ends)[:, 0]
        into: Array = -np.matmul(self.ends, flows[:, :, None])[:, :, 0]
        return into


@dataclass(frozen=True)
class _Stacked:
    """The terms of one kind of a batch."""

    kind: str
    added: Sequence[Added]
    courses: Array = field(init=False)
    patterns: Array = field(init=False)

    def __post_init__(self) -> None:
        most = max(len(_of(self.kind, each)) for each in self.added)
        count = max(len(term.course) for each in self.added for term in _of(self.kind, each))
        courses = np.zeros((count, len(self.added), most))
        patterns = np.zeros((len(self.added), most, _PHONE))
        for index, each in enumerate(self.added):
            for place, term in enumerate(_of(self.kind, each)):
                courses[: len(term.course), index, place] = term.course
                patterns[index, place] = term.pattern
        object.__setattr__(self, "courses", courses)
        object.__setattr__(self, "patterns", patterns)

    def at(self, k: int) -> Array:
        """The coefficients from sample ``k`` on, shape (batch, nodes)."""
        course = self.courses[min(k, len(self.courses) - 1)]
        result: Array = np.matmul(course[:, None, :], self.patterns)[:, 0]
        return np.maximum(result, _LEAST_LOSS - 1.0) if self.kind in _COVERING else result


def _of(kind: str, added: Added) -> list[Term]:
    return [term for term in added.terms if term.kind == kind]


def _linked(added: Sequence[Added], width: int) -> tuple[Array, Array]:
    """Ends, shape (batch, width + 1, links), and conductances, shape (n, batch, links); none after a run's end."""
    most = max((len(each.links) for each in added), default=0)
    count = max((len(link.conductance_W_K) for each in added for link in each.links), default=1)
    ends = np.zeros((len(added), width + 1, most))
    conductances = np.zeros((count, len(added), most))
    for index, each in enumerate(added):
        places = {AIR: width, **{node: place for place, node in enumerate(NODES)}}
        places.update({body.name: _PHONE + place for place, body in enumerate(each.bodies)})
        for number, link in enumerate(each.links):
            ends[index, places[link.one], number] = 1.0
            ends[index, places[link.other], number] = -1.0
            conductances[: len(link.conductance_W_K), index, number] = link.conductance_W_K
    return ends, conductances


def _resting(one: Additions, start: Array, air_degC: Array, demand: Demand) -> Array:
    physics = one.during(0)
    free = np.isfinite(one.capacitance[0])

    def rates(found: Array) -> Array:
        state = start.copy()
        state[free] = found
        return physics.rates(state[None], air_degC, demand)[0, free]

    found = np.asarray(root(rates, start[free], method="hybr", tol=1e-12).x)
    if np.abs(rates(found)).max() > 1e-8:
        raise refuse("simulation", "", "no thermal equilibrium with what is hidden", "hide less, or from later on")
    result = start.copy()
    result[free] = found
    return result
