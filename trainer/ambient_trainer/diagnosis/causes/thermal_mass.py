"""A body that the circuit lacks takes up heat at a node and gives it back."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_body
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Estimate, Parameters, Setting, Span, positive
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

_NAME = "thermal_mass"
_FASTEST_PERIODS = 6.0
_SLOWEST_S = 6 * 3600.0
_SHAPES = 6


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """At every node: it takes up (T_i - lag of T_i) / R, the lag being R C of the body."""
    fastest = _FASTEST_PERIODS * setting.plant.period_s
    for node in range(len(setting.plant.nodes)):
        for time_constant_s in np.geomspace(fastest, max(_SLOWEST_S, 40 * fastest), _SHAPES):
            yield _attached(setting, node, float(time_constant_s))


def _attached(setting: Setting, node: int, time_constant_s: float) -> Candidate:
    name = setting.plant.nodes[node]
    scale, unit = setting.heat_unit(node)
    absolute = unit == "W"

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.ones, setting.into(node, lambda nodes, air: -nodes[node]), lag_s=time_constant_s),)

    def magnitude(estimate: Estimate) -> Magnitude:
        conductance = float(estimate.values[0])
        capacity = scale * time_constant_s * conductance
        # the capacity is the product of both: their logarithms' deviations go together
        half = abs(capacity) * estimate.half_width(np.array([1.0 / conductance, 1.0]))
        meaning = f"heat capacity that hangs on {name}" + ("" if absolute else ", over the node's own")
        return Magnitude(capacity, "J/K" if absolute else "1", meaning, (capacity - half, capacity + half))

    def parameters(estimate: Estimate) -> Parameters:
        conductance = scale * float(estimate.values[0])
        return {"time_constant": (time_constant_s, "s"), "conductance": (conductance, setting.conductance_unit)}

    def extend(circuit: Circuit, values: Array) -> Circuit:
        conductance = float(values[0])
        return with_body(circuit, name, conductance * time_constant_s, 1.0 / conductance)

    return Candidate(
        Cause(_NAME, name),
        Span.WINDOW,
        terms,
        magnitude,
        parameters,
        plausible=positive,
        shape=time_constant_s,
        reshaped=lambda shape: _attached(setting, node, shape),
        extend=extend,
    )


KIND = CauseKind(
    _NAME,
    "a thermal mass that the circuit lacks",
    "a body that the circuit lacks hangs on {place}",
    _candidates,
    rank=50,
    built_in=True,
)
