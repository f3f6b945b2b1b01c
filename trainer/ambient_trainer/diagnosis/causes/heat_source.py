"""Heat into a node: by a logged signal, by a current squared, or by nothing that was logged."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_source
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Parameters, Setting, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View
from ambient_trainer.diagnosis.words import unit_of

Array = NDArray[np.float64]

NAME = "heat_source"
_COLD_BELOW_DEGC = 25.0


def candidates(setting: Setting) -> Iterator[Candidate]:
    """Every node, by every signal and by none; a current also squared, with a resistance that may grow in the cold."""
    for node, name in enumerate(setting.plant.nodes):
        yield _unlogged(setting, node, name)
        for signal in setting.signals:
            yield _driven(setting, node, name, signal)
            if signal.endswith("_A"):
                yield _squared(setting, node, name, signal)
                yield _squared_in_the_cold(setting, node, name, signal)


def _unlogged(setting: Setting, node: int, name: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.ones, setting.into(node, _one)),)

    def magnitude(found: Estimate) -> Magnitude:
        return Magnitude(
            scale * float(found.values[0]), unit, f"heat into {name} while it lasts", found.interval(0, scale)
        )

    return Candidate(Cause(NAME, name), Span.WINDOW, terms, magnitude)


def _driven(setting: Setting, node: int, name: str, signal: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.signal(signal), setting.into(node, _one)),)

    def magnitude(found: Estimate) -> Magnitude:
        value = scale * float(found.values[0])
        return Magnitude(value, per(unit, signal), f"heat into {name} per {signal}", found.interval(0, scale))

    def extend(circuit: Circuit, values: Array) -> Circuit:
        return with_source(circuit, name, signal, float(values[0]), per("W", signal))

    return Candidate(Cause(NAME, name, signal), Span.WHOLE, terms, magnitude, extend=extend)


def _squared(setting: Setting, node: int, name: str, signal: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.signal(signal) ** 2, setting.into(node, _one)),)

    def magnitude(found: Estimate) -> Magnitude:
        value = scale * float(found.values[0])
        return Magnitude(value, f"{unit}/A^2", f"heat into {name} per {signal} squared", found.interval(0, scale))

    return Candidate(
        Cause(NAME, name, signal), Span.WHOLE, terms, magnitude, plausible=lambda values: values[..., 0] > 0
    )


def _squared_in_the_cold(setting: Setting, node: int, name: str, signal: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        squared = view.signal(signal) ** 2
        return (
            HeatTerm(squared, setting.into(node, _one)),
            HeatTerm(squared, setting.into(node, lambda nodes, air: _COLD_BELOW_DEGC - nodes[node])),
        )

    def magnitude(found: Estimate) -> Magnitude:
        value = scale * float(found.values[0])
        meaning = f"heat into {name} per {signal} squared at {_COLD_BELOW_DEGC:g} degC, growing in the cold"
        return Magnitude(value, f"{unit}/A^2", meaning, found.interval(0, scale))

    def parameters(found: Estimate) -> Parameters:
        return {"growth_per_K": (float(found.values[1] / found.values[0]), "1/K")}

    return Candidate(
        Cause(NAME, name, signal),
        Span.WHOLE,
        terms,
        magnitude,
        parameters,
        fixed=(None, None),
        plausible=lambda values: np.asarray((values > 0).all(axis=-1)),
    )


def _one(nodes_degC: Array, ambient_degC: Array) -> Array:
    return np.ones_like(ambient_degC)


def per(unit: str, signal: str) -> str:
    """``unit`` per unit of a trace column: on/off signals and fractions have none."""
    return f"{unit} per {unit_of(signal)}" if unit_of(signal) else unit
