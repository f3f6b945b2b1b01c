"""A wiring with its fitted values becomes the circuit of a file: what carries nothing is not drawn.

A search for resistances takes an edge away by making it enormous. Where it carries less than a thousandth of what its
states exchange, the file is without it, and the estimate is the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ambient_trainer.circuits.circuit import Circuit, Edge
from ambient_trainer.selection.wiring import Pair, Wiring, groups

_NOTHING = 1e-3


def fitted_circuit(circuit: Circuit, wiring: Wiring, values: Mapping[str, float]) -> tuple[Circuit, Wiring]:
    """``circuit`` of ``wiring``, which starts at ``values``, and both without the edges that carry nothing."""
    free = {each.name for each in circuit.parameters if each.free}
    open_edges = [each for each in circuit.edges if each.resistance in free and _idle(each, circuit, values)]
    gone = {each.resistance for each in open_edges}
    edges = tuple(each for each in circuit.edges if each not in open_edges)
    drawn = {_pair(each) for each in edges}
    less = replace(wiring, edges=tuple(each for each in wiring.edges if each in drawn))
    # whoever is on its own now has a scale of its own
    firsts = {group[0] for group in groups(less)} if less.form == "temperature" else set()
    held = {node.capacitance for node in circuit.states if node.name in firsts}
    parameters = tuple(
        replace(
            each,
            initial=float(np.clip(values[each.name], each.low, each.high)),
            free=each.free and each.name not in held,
        )
        for each in circuit.parameters
        if each.name not in gone
    )
    return replace(circuit, edges=edges, parameters=parameters), less


def _idle(edge: Edge, circuit: Circuit, values: Mapping[str, float]) -> bool:
    """Whether it is a thousandth of the conductance of every state that it joins."""
    states = {each.name for each in circuit.states}
    for end in set(edge.between) & states:
        whole = sum(1 / values[each.resistance] for each in circuit.edges if end in each.between)
        if 1 / values[edge.resistance] > _NOTHING * whole:
            return False
    return True


def _pair(edge: Edge) -> Pair:
    a, b = sorted(edge.between)
    return a, b
