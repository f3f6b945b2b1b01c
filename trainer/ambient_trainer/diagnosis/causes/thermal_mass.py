"""A body that the circuit lacks takes up heat at a node and gives it back."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_body
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Parameters, Setting, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

NAME = "thermal_mass"
_FASTEST_PERIODS = 6.0
_SLOWEST_S = 6 * 3600.0
_SHAPES = 6


def candidates(setting: Setting) -> Iterator[Candidate]:
    """At every node: it takes up (T_i - lag of T_i) / R, the lag being R C of the body."""
    fastest = _FASTEST_PERIODS * setting.plant.period_s
    for node in range(len(setting.plant.nodes)):
        for time_constant_s in np.geomspace(fastest, max(_SLOWEST_S, 40 * fastest), _SHAPES):
            yield _attached(setting, node, float(time_constant_s))


def _attached(setting: Setting, node: int, time_constant_s: float) -> Candidate:
    name = setting.plant.nodes[node]
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.ones, setting.into(node, lambda nodes, air: -nodes[node]), lag_s=time_constant_s),)

    def magnitude(found: Estimate) -> Magnitude:
        conductance = float(found.values[0])
        capacity = scale * time_constant_s * conductance
        # the capacity is the product of both: their logarithms' deviations go together
        slope = np.array([1.0 / conductance, 1.0])
        half = 1.96 * abs(capacity) * float(np.sqrt(max(slope @ found.covariance @ slope, 0.0)))
        return Magnitude(
            capacity,
            "J/K" if unit == "W" else "1",
            f"heat capacity that hangs on {name}" + ("" if unit == "W" else ", over the node's own"),
            (capacity - half, capacity + half),
        )

    def parameters(found: Estimate) -> Parameters:
        conductance = scale * float(found.values[0])
        return {
            "time_constant": (time_constant_s, "s"),
            "conductance": (conductance, setting.conductance_unit),
        }

    def extend(circuit: Circuit, values: Array) -> Circuit:
        conductance = float(values[0])
        return with_body(circuit, name, conductance * time_constant_s, 1.0 / conductance)

    return Candidate(
        Cause(NAME, name),
        Span.WINDOW,
        terms,
        magnitude,
        parameters,
        plausible=lambda values: values[..., 0] > 0,
        shape=time_constant_s,
        reshaped=lambda shape: _attached(setting, node, shape),
        extend=extend,
    )
