"""Heat is conducted between two nodes that the circuit does not join."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_edge
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Setting, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View, joined

Array = NDArray[np.float64]

NAME = "path"


def candidates(setting: Setting) -> Iterator[Candidate]:
    """Every pair of nodes without an edge."""
    there = joined(setting.plant)
    for one, other in combinations(range(len(setting.plant.nodes)), 2):
        if frozenset((setting.plant.nodes[one], setting.plant.nodes[other])) not in there:
            yield _joined(setting, one, other)


def _joined(setting: Setting, one: int, other: int) -> Candidate:
    names = setting.plant.nodes
    scale, _ = setting.heat_unit(one)

    def law(nodes_degC: Array, ambient_degC: Array) -> Array:
        flow = nodes_degC[other] - nodes_degC[one]
        heat = np.zeros_like(nodes_degC)
        heat[one], heat[other] = flow, -flow
        return heat

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.ones, law),)

    def magnitude(found: Estimate) -> Magnitude:
        meaning = f"conductance between {names[one]} and {names[other]}"
        value = scale * float(found.values[0])
        return Magnitude(value, setting.conductance_unit, meaning, found.interval(0, scale))

    def extend(circuit: Circuit, values: Array) -> Circuit:
        return with_edge(circuit, names[one], names[other], 1.0 / float(values[0]))

    return Candidate(
        Cause(NAME, f"{names[one]}-{names[other]}"),
        Span.WINDOW,
        terms,
        magnitude,
        plausible=lambda values: values[..., 0] > 0,
        extend=extend,
    )
