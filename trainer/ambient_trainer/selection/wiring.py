"""A wiring is which nodes store heat and which are joined; it becomes circuit data, with as little else as can be told.

In ``rise`` form the states are sensors' own nodes, each joined to the ambient, driven by what flows between sensors
(the thesis's circuits). In ``temperature`` form they are hidden nodes behind the sensors. Temperatures alone never tell
how much heat there is: per group of joined states one capacitance or resistance is set, the others follow from it.
(Hidden nodes that are joined can be told only up to a mixture of them: their estimate is one, their values are not.)
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from ambient_model.faults import Refused
from ambient_trainer.circuits.circuit import AMBIENT, Circuit, Form
from ambient_trainer.circuits.schema import parse_circuit

_CAPACITANCE = 10.0
"""J/K, where the data leave it open."""

_LARGEST_WEIGHT = 10.0

Pair = tuple[str, str]


@dataclass(frozen=True)
class Wiring:
    """``sensors`` in order; ``states`` and ``edges`` sorted, an edge by its ends."""

    form: Form
    sensors: tuple[str, ...]
    states: tuple[str, ...]
    edges: tuple[Pair, ...]

    @property
    def text(self) -> str:
        """The wiring as one line, for a key."""
        return json.dumps([self.form, self.sensors, self.states, self.edges])

    @staticmethod
    def of_text(text: str) -> Wiring:
        """The inverse of :attr:`text`."""
        form, sensors, states, edges = json.loads(text)
        return Wiring(form, tuple(sensors), tuple(states), tuple((a, b) for a, b in edges))

    @property
    def complete(self) -> bool:
        """Whether there are states and all are driven: in rises by an exchange, in temperatures from some sensor."""
        if not self.states:
            return False
        if self.form == "rise":
            return all(any(state in edge for edge in self.edges) for state in self.states)
        reached = set(self.sensors)
        for _ in self.states:
            reached |= {end for edge in self.edges if reached & set(edge) for end in edge}
        return reached >= set(self.states)


def starting_wirings(sensors: Sequence[str], most_states: int) -> list[Wiring]:
    """Where the search for a wiring starts: every sensor's node joined to every other's, and hidden ones to all."""
    hidden = [f"hidden{k + 1}" for k in range(most_states)]
    found = [_tidy("temperature", sensors, hidden, list(itertools.product(hidden, sensors)))]
    if len(sensors) > 1:
        states = list(sensors[:most_states])
        pairs = [(a, b) for a, b in itertools.combinations(sensors, 2) if a in states or b in states]
        found.insert(0, _tidy("rise", sensors, states, pairs))
    return found


def neighbours(wiring: Wiring, most_states: int) -> list[Wiring]:
    """The wirings that one edge more or less, or one state more or less, makes of this one."""
    form, sensors, states, edges = wiring.form, wiring.sensors, wiring.states, wiring.edges
    found = []
    ends = sensors if form == "rise" else (*sensors, *states)
    for pair in itertools.combinations(ends, 2):
        if set(pair) & set(states):
            pair = _sorted(pair)
            found.append(_tidy(form, sensors, states, set(edges) ^ {pair}))
    for state in states:
        rest = [each for each in states if each != state]
        kept = [edge for edge in edges if set(edge) & set(rest) and (form == "rise" or state not in edge)]
        found.append(_tidy(form, sensors, rest, kept))
    if len(states) < most_states:
        new = [each for each in sensors if each not in states] if form == "rise" else [f"hidden{len(states) + 1}"]
        for state in new:
            more = [] if any(state in edge for edge in edges) else [(state, each) for each in sensors if each != state]
            found.append(_tidy(form, sensors, [*states, state], [*edges, *more]))
    usable = [each for each in found if each.complete and each != wiring]
    return list(dict.fromkeys(usable))


def without(wiring: Wiring, edges: Sequence[Pair]) -> Wiring:
    """The wiring less these edges, and less the states that have none left."""
    kept = [each for each in wiring.edges if each not in edges]
    states = [each for each in wiring.states if any(each in edge for edge in kept)]
    return _tidy(wiring.form, wiring.sensors, states, kept)


def circuit_of(wiring: Wiring, tau_s: Sequence[float], name: str, about: str) -> Circuit:
    """The circuit; its states start with the time constants ``tau_s``, in turn."""
    start = {state: tau_s[k % len(tau_s)] for k, state in enumerate(wiring.states)}
    parameters: dict[str, Any] = {}
    nodes: dict[str, Any] = {each: {"sensor": each} for each in wiring.sensors}
    firsts = {group[0] for group in groups(wiring)}
    for state in wiring.states:
        known = wiring.form == "rise" or state in firsts
        capacitance = _CAPACITANCE if known else _parameter(parameters, f"C_{state}", "J/K", _CAPACITANCE)
        nodes[state] = {"capacitance": capacitance, **nodes.get(state, {})}
    edges = []
    scaled: set[str] = set()
    for a, b in wiring.edges:
        state = a if a in start else b
        resistance = start[state] / _CAPACITANCE * (1 if wiring.form == "rise" else _degree(wiring, state))
        group = next(each[0] for each in groups(wiring) if state in each)
        value: Any = resistance
        if wiring.form == "temperature" or group in scaled:
            value = _parameter(parameters, f"R_{a}_{b}", "K/W", resistance)
        scaled.add(group)
        edges.append({"between": [a, b], "resistance": value})
    if wiring.form == "rise":
        for state in wiring.states:
            value = _parameter(parameters, f"R_{state}_{AMBIENT}", "K/W", start[state] / _CAPACITANCE)
            edges.append({"between": [state, AMBIENT], "resistance": value})
    output = {
        "states": {each: _weight(parameters, f"c_{each}", 0.0) for each in wiring.states},
        "inputs": {
            f"{each}_degC": _weight(parameters, f"d_{each}", 1 / len(wiring.sensors)) for each in wiring.sensors
        },
        "offset": _parameter(parameters, "offset", "degC", 0.0),
    }
    data = {
        "format": "ambient-circuit",
        "version": 1,
        "name": name,
        "about": about,
        "form": wiring.form,
        "nodes": nodes,
        "edges": edges,
        "outputs": {AMBIENT: output},
        "parameters": parameters,
    }
    return parse_circuit(yaml.safe_dump(data, sort_keys=False), name)


def can_be_named(sensor: str) -> bool:
    """Whether a circuit file can name this sensor's column: not every zone's name is one there."""
    wiring = _tidy("temperature", [sensor], ["hidden1"], [("hidden1", sensor)])
    try:
        circuit_of(wiring, [1.0], "probe", "probe")
    except Refused:
        return False
    return sensor != AMBIENT and not sensor.startswith("hidden")


def _tidy(form: Form, sensors: Sequence[str], states: Sequence[str], edges: Any) -> Wiring:
    """The wiring in its one spelling: hidden nodes numbered so that the edges come first in order."""
    if form == "rise":
        return Wiring(form, tuple(sensors), tuple(sorted(states)), tuple(sorted(map(_sorted, edges))))
    names = [f"hidden{k + 1}" for k in range(len(states))]
    spellings = []
    for order in itertools.permutations(names):
        renamed = dict(zip(states, order))
        spellings.append(tuple(sorted(_sorted((renamed.get(a, a), renamed.get(b, b))) for a, b in edges)))
    return Wiring(form, tuple(sensors), tuple(names), min(spellings))


def _sorted(pair: Sequence[str]) -> Pair:
    a, b = sorted(pair)
    return a, b


def groups(wiring: Wiring) -> list[list[str]]:
    """The states that are joined to one another, directly or by other states, each group sorted."""
    groups: list[set[str]] = []
    for state in wiring.states:
        near = {state} | {end for edge in wiring.edges if state in edge for end in edge if end in wiring.states}
        joined = [each for each in groups if each & near]
        groups = [each for each in groups if not each & near] + [near.union(*joined)]
    return [sorted(each) for each in groups]


def _degree(wiring: Wiring, state: str) -> int:
    return sum(state in edge for edge in wiring.edges)


def _weight(parameters: dict[str, Any], name: str, initial: float) -> str:
    """A weight in the output: two states of nearly one time constant must not cancel in their thousands."""
    name = _parameter(parameters, name, "1", initial)
    parameters[name] |= {"min": -_LARGEST_WEIGHT, "max": _LARGEST_WEIGHT}
    return name


def _parameter(parameters: dict[str, Any], name: str, unit: str, initial: float) -> str:
    """Make a parameter of this or, where another has it already, a longer name."""
    while name in parameters:
        name += "_"
    parameters[name] = {"unit": unit, "initial": float(initial)}
    return name
