"""Heat is conducted between two nodes that the circuit does not join."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_edge
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import (
    Candidate,
    CauseKind,
    Setting,
    Span,
    first_coefficient,
    heat,
    positive,
)
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.diagnosis.view import joined

Array = NDArray[np.float64]

_NAME = "path"


def _candidates(setting: Setting) -> Iterator[Candidate]:
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
        into = np.zeros_like(nodes_degC)
        into[one], into[other] = flow, -flow
        return into

    def extend(circuit: Circuit, values: Array) -> Circuit:
        return with_edge(circuit, names[one], names[other], 1.0 / float(values[0]))

    cause = Cause(_NAME, f"{names[one]}-{names[other]}")
    meaning = f"conductance between {names[one]} and {names[other]}"
    magnitude = first_coefficient(setting.conductance_unit, meaning, scale)
    return Candidate(cause, Span.WINDOW, heat(law), magnitude, plausible=positive, extend=extend)


KIND = CauseKind(
    _NAME,
    "a conduction path that the circuit lacks",
    "heat is conducted between {place}",
    _candidates,
    rank=60,
    built_in=True,
)
