"""The topology of a circuit: which nodes store heat and which are joined; and the circuit of it that data can identify.

In ``rise`` form the states are sensors' own nodes, each joined to the ambient, driven by what flows between sensors
(the thesis's circuits); in ``temperature`` form they are hidden nodes behind the sensors. Temperatures alone do not
identify how much heat there is: per group of joined states one capacitance or resistance is set.

The search is stepwise: from each start the best neighbour, as long as one lowers the held-out error by 1 %. Then the
best loses edges again, as many as leave its error within 1 %.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ambient_model.faults import Refused
from ambient_trainer.circuits import AMBIENT, Circuit, Edge, Form, circuit_of_data
from ambient_trainer.circuits.addition import started

_CAPACITANCE_J_K = 10.0
"""Where the data leave the scale open; any value gives the same estimate."""
_LARGEST_WEIGHT = 10.0
"""Of a state in the output: two states of nearly one time constant must not cancel in their thousands."""
_IDLE_SHARE = 1e-3
"""Of the conductance of both its states: what an edge below it conducts changes no estimate by a reading's noise."""
_GAIN = 0.01
"""Chosen: less is within what another seed of the same run changes."""
_PRUNINGS = 8

Pair = tuple[str, str]
Score = Callable[[Sequence["Topology"]], Sequence[float]]
"""The held-out error of each topology in degC."""


@dataclass(frozen=True)
class Topology:
    """``sensors`` in order; ``states`` and ``edges`` sorted, an edge by its ends."""

    form: Form
    sensors: tuple[str, ...]
    states: tuple[str, ...]
    edges: tuple[Pair, ...]

    @property
    def complete(self) -> bool:
        """Whether there are states and all are driven: in rises by an exchange, in temperatures from some sensor."""
        if self.form == "rise":
            return bool(self.states) and set(self.states) <= {end for edge in self.edges for end in edge}
        joined = _components((*self.sensors, *self.states), self.edges)
        return bool(self.states) and all(each & set(self.sensors) for each in joined)

    @property
    def groups(self) -> list[list[str]]:
        """The states that are joined to one another, directly or by other states, each group sorted."""
        return [sorted(each) for each in _components(self.states, self.edges)]


def initial_topologies(sensors: Sequence[str], most_states: int) -> list[Topology]:
    """Where the search starts: every sensor's node joined to every other's, and hidden ones to all."""
    hidden = [f"hidden{k + 1}" for k in range(most_states)]
    starts = [_canonical("temperature", sensors, hidden, itertools.product(hidden, sensors))]
    if len(sensors) > 1:
        states = list(sensors[:most_states])
        pairs = [pair for pair in itertools.combinations(sensors, 2) if set(pair) & set(states)]
        starts.insert(0, _canonical("rise", sensors, states, pairs))
    return starts


def neighbours(topology: Topology, most_states: int) -> list[Topology]:
    """The topologies that one edge more or less, or one state more or less, makes of this one."""
    form, sensors, states, edges = topology.form, topology.sensors, topology.states, topology.edges
    near = []
    ends = sensors if form == "rise" else (*sensors, *states)
    for pair in itertools.combinations(ends, 2):
        if set(pair) & set(states):
            near.append(_canonical(form, sensors, states, set(edges) ^ {_sorted(pair)}))
    for state in states:
        rest = [each for each in states if each != state]
        kept = [edge for edge in edges if set(edge) & set(rest) and (form == "rise" or state not in edge)]
        near.append(_canonical(form, sensors, rest, kept))
    if len(states) < most_states:
        new = [each for each in sensors if each not in states] if form == "rise" else [f"hidden{len(states) + 1}"]
        for state in new:
            more = [] if any(state in edge for edge in edges) else [(state, each) for each in sensors if each != state]
            near.append(_canonical(form, sensors, [*states, state], [*edges, *more]))
    return list(dict.fromkeys(each for each in near if each.complete and each != topology))


def without(topology: Topology, edges: Sequence[Pair]) -> Topology:
    """The topology less these edges, and less the states that have none left."""
    kept = [each for each in topology.edges if each not in edges]
    states = [each for each in topology.states if any(each in edge for edge in kept)]
    return _canonical(topology.form, topology.sensors, states, kept)


def best_topology(sensors: Sequence[str], most_states: int, score: Score) -> Topology:
    """The topology of ``sensors`` that the steps lead to, less the edges that it can do without."""
    tried: dict[Topology, float] = {}
    for start in initial_topologies(sensors, most_states):
        around, error = [start], math.inf
        while around:
            errors = score(around)
            tried.update(zip(around, errors))
            least, best = min(zip(errors, range(len(around))))
            if least >= (1 - _GAIN) * error:
                break
            error, around = least, neighbours(around[best], most_states)
    limit_degC = (1 + _GAIN) * min(tried.values())
    topology = min(tried, key=lambda each: (tried[each], len(each.edges)))
    # less as many edges as the limit allows, those first that cost least by themselves
    alone = [(edge, less) for edge in topology.edges for less in [without(topology, [edge])] if less.complete]
    order = [edge for _, (edge, _) in sorted(zip(score([less for _, less in alone]), alone))]
    counts = sorted({round(each) for each in np.linspace(1, len(order), min(len(order), _PRUNINGS))})
    usable = [less for count in counts if (less := without(topology, order[:count])).complete]
    good = [each for each, error in zip(usable, score(usable)) if error <= limit_degC]
    return good[-1] if good else topology


def circuit_of(topology: Topology, tau_s: Sequence[float], name: str, about: str) -> Circuit:
    """The circuit; its states start with the time constants ``tau_s``, in turn."""
    rise = topology.form == "rise"
    parameters: dict[str, Any] = {}

    def parameter(name: str, unit: str, initial: float, **bounds: float) -> str:
        while name in parameters:  # names of sensors may run together
            name += "_"
        parameters[name] = {"unit": unit, "initial": float(initial), **bounds}
        return name

    start_K_W = {
        state: tau_s[k % len(tau_s)] / _CAPACITANCE_J_K * (1 if rise else sum(state in each for each in topology.edges))
        for k, state in enumerate(topology.states)
    }
    first_of = {state: group[0] for group in topology.groups for state in group}
    nodes: dict[str, Any] = {each: {"sensor": each} for each in topology.sensors}
    for state in topology.states:
        scaled = rise or state == first_of[state]
        capacitance = _CAPACITANCE_J_K if scaled else parameter(f"C_{state}", "J/K", _CAPACITANCE_J_K)
        nodes[state] = {"capacitance": capacitance, **nodes.get(state, {})}
    edges: list[dict[str, Any]] = []
    set_already: set[str] = set()
    for a, b in topology.edges:
        state = a if a in start_K_W else b
        free = not rise or first_of[state] in set_already
        set_already.add(first_of[state])
        resistance = parameter(f"R_{a}_{b}", "K/W", start_K_W[state]) if free else start_K_W[state]
        edges.append({"between": [a, b], "resistance": resistance})
    for state in topology.states if rise else ():
        resistance = parameter(f"R_{state}_{AMBIENT}", "K/W", start_K_W[state])
        edges.append({"between": [state, AMBIENT], "resistance": resistance})
    bounds = {"min": -_LARGEST_WEIGHT, "max": _LARGEST_WEIGHT}
    share = 1 / len(topology.sensors)
    output = {
        "states": {each: parameter(f"c_{each}", "1", 0.0, **bounds) for each in topology.states},
        "inputs": {f"{each}_degC": parameter(f"d_{each}", "1", share, **bounds) for each in topology.sensors},
        "offset": parameter("offset", "degC", 0.0),
    }
    data = {"format": "ambient-circuit", "version": 1, "name": name, "about": about, "form": topology.form}
    data |= {"nodes": nodes, "edges": edges, "outputs": {AMBIENT: output}, "parameters": parameters}
    return circuit_of_data(data, name)


def can_be_named(sensor: str) -> bool:
    """Whether a circuit file can name this sensor's column: not every zone's name is one there."""
    if sensor == AMBIENT or sensor.startswith("hidden"):
        return False
    try:
        circuit_of(initial_topologies([sensor], 1)[0], [1.0], "probe", "probe")
    except Refused:
        return False
    return True


def pruned(circuit: Circuit, topology: Topology, values: Mapping[str, float]) -> tuple[Circuit, Topology]:
    """``circuit`` of ``topology``, which starts at ``values``, and both without the edges that conduct nothing.

    A search for resistances removes an edge by making it enormous: the estimate is the same without it.
    """
    free = {each.name for each in circuit.parameters if each.free}
    idle = {each.resistance for each in circuit.edges if each.resistance in free and _idle(each, circuit, values)}
    edges = tuple(each for each in circuit.edges if each.resistance not in idle)
    kept = {_sorted(each.between) for each in edges}
    less = replace(topology, edges=tuple(each for each in topology.edges if each in kept))
    # a state that is alone now has a scale of its own
    firsts = {group[0] for group in less.groups} if less.form == "temperature" else set()
    held = {str(node.capacitance) for node in circuit.states if node.name in firsts}
    parameters = tuple(each for each in circuit.parameters if each.name not in idle)
    return started(replace(circuit, edges=edges, parameters=parameters), values, held), less


def _idle(edge: Edge, circuit: Circuit, values: Mapping[str, float]) -> bool:
    """Whether the edge is a thousandth of the conductance of every state that it joins."""
    ends = set(edge.between) & {each.name for each in circuit.states}
    wholes = [sum(1 / values[each.resistance] for each in circuit.edges if end in each.between) for end in ends]
    return all(1 / values[edge.resistance] <= _IDLE_SHARE * whole for whole in wholes)


def _canonical(form: Form, sensors: Sequence[str], states: Sequence[str], edges: Iterable[Sequence[str]]) -> Topology:
    """The topology in its one spelling: hidden nodes numbered so that the edges come first in order."""
    edges = list(edges)
    if form == "rise":
        return Topology(form, tuple(sensors), tuple(sorted(states)), tuple(sorted(map(_sorted, edges))))
    names = [f"hidden{k + 1}" for k in range(len(states))]
    spellings = []
    for order in itertools.permutations(names):
        renamed = dict(zip(states, order))
        spellings.append(tuple(sorted(_sorted([renamed.get(each, each) for each in edge]) for edge in edges)))
    return Topology(form, tuple(sensors), tuple(names), min(spellings))


def _sorted(pair: Sequence[str]) -> Pair:
    a, b = sorted(pair)
    return a, b


def _components(nodes: Iterable[str], edges: Iterable[Pair]) -> list[set[str]]:
    """The connected components of ``nodes``; an edge to anything else joins nothing."""
    parts = [{each} for each in nodes]
    for edge in edges:
        joined = [each for each in parts if each & set(edge)]
        parts = [each for each in parts if each not in joined] + ([set().union(*joined)] if joined else [])
    return parts
