"""Heat into a node: by a logged signal, by a current squared, or by nothing that was logged."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_source
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import (
    Candidate,
    CauseKind,
    Estimate,
    Parameters,
    Setting,
    Span,
    constant,
    first_coefficient,
    heat,
    per,
    positive,
)
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View
from ambient_trainer.diagnosis.words import share

Array = NDArray[np.float64]

_NAME = "heat_source"
_COLD_BELOW_DEGC = 25.0


def _candidates(setting: Setting) -> Iterator[Candidate]:
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
    magnitude = first_coefficient(unit, f"heat into {name} while it lasts", scale)
    return Candidate(Cause(_NAME, name), Span.WINDOW, heat(setting.into(node, constant)), magnitude)


def _driven(setting: Setting, node: int, name: str, signal: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.signal(signal), setting.into(node, constant)),)

    def extend(circuit: Circuit, values: Array) -> Circuit:
        return with_source(circuit, name, signal, float(values[0]), per("W", signal))

    magnitude = first_coefficient(per(unit, signal), f"heat into {name} per {signal}", scale)
    return Candidate(Cause(_NAME, name, signal), Span.WHOLE, terms, magnitude, extend=extend)


def _squared(setting: Setting, node: int, name: str, signal: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (HeatTerm(view.signal(signal) ** 2, setting.into(node, constant)),)

    magnitude = first_coefficient(f"{unit}/A^2", f"heat into {name} per {signal} squared", scale)
    return Candidate(Cause(_NAME, name, signal), Span.WHOLE, terms, magnitude, plausible=positive)


def _squared_in_the_cold(setting: Setting, node: int, name: str, signal: str) -> Candidate:
    scale, unit = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        squared = view.signal(signal) ** 2
        return (
            HeatTerm(squared, setting.into(node, constant)),
            HeatTerm(squared, setting.into(node, lambda nodes, air: _COLD_BELOW_DEGC - nodes[node])),
        )

    def growth_per_K(estimate: Estimate) -> float:
        return float(estimate.values[1] / estimate.values[0])

    def magnitude(estimate: Estimate) -> Magnitude:
        grows = f"growing in the cold by {share(growth_per_K(estimate))} per K"
        meaning = f"heat into {name} per {signal} squared at {_COLD_BELOW_DEGC:g} degC, {grows}:"
        value, interval = scale * float(estimate.values[0]), estimate.interval(0, scale)
        return Magnitude(value, f"{unit}/A^2", meaning, interval, grows)

    def parameters(estimate: Estimate) -> Parameters:
        return {"growth_per_K": (growth_per_K(estimate), "1/K")}

    cause = Cause(_NAME, name, signal)
    return Candidate(cause, Span.WHOLE, terms, magnitude, parameters, fixed=(None, None), plausible=positive)


def _not_in_circuit(cause: Cause) -> str:
    if cause.signal is None:
        return "a source of a circuit follows a logged signal: log what drives it"
    return f"a source of a circuit is proportional to its signal: log {cause.signal} squared beside it"


KIND = CauseKind(
    _NAME,
    "heat that the circuit does not know",
    "a source heats {place}",
    _candidates,
    _not_in_circuit,
    rank=10,
    built_in=True,
    heats=True,
    one_sign=True,
)
