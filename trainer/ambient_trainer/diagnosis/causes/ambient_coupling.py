"""The resistance to the ambient changed: a case, a fan, wind; of one node, or of all alike."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_ambient_conductance
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Parameters, Setting, Span
from ambient_trainer.diagnosis.causes.heat_source import per
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View, conductances_to_ambient

Array = NDArray[np.float64]

NAME = "ambient_coupling"


def candidates(setting: Setting) -> Iterator[Candidate]:
    """All nodes alike, and each that is joined to the ambient; by nothing logged and by every signal."""
    for place in places(setting):
        for signal in (None, *setting.signals):
            yield _changed(setting, place, signal)


def places(setting: Setting) -> list[int | None]:
    """The nodes joined to the ambient, None standing for all of them alike."""
    joined = np.flatnonzero(conductances_to_ambient(setting.plant)).tolist()
    return [None, *joined] if len(joined) > 1 else [None] if joined else []


def _changed(setting: Setting, node: int | None, signal: str | None) -> Candidate:
    """A relative change g of the conductances: each node gives off g times what it does more."""

    def terms(view: View) -> tuple[HeatTerm, ...]:
        loss = setting.loss(view.plant)
        affected = np.arange(len(view.plant.nodes)) == node if node is not None else np.ones(len(view.plant.nodes))

        def law(nodes_degC: Array, ambient_degC: Array) -> Array:
            return -(affected * loss(nodes_degC, ambient_degC).T).T

        return (HeatTerm(_weight(view, signal), law),)

    def magnitude(found: Estimate) -> Magnitude:
        scale = 1.0 if signal is None else _per_unit(setting, found.view, signal, node)
        change, (low, high) = scale * float(found.values[0]), found.interval(0, scale)
        where = "all nodes" if node is None else setting.plant.nodes[node]
        ends = sorted((_resistance(low), _resistance(high)))
        unit = "1" if signal is None else per("1", signal)
        meaning = f"relative change of the resistance from {where} to the ambient"
        return Magnitude(_resistance(change), unit, meaning, (ends[0], ends[1]))

    def parameters(found: Estimate) -> Parameters:
        return {"conductance_change": (float(found.values[0]), "1")}

    location = None if node is None else setting.plant.nodes[node]

    def extend(circuit: Circuit, values: Array) -> Circuit:
        return with_ambient_conductance(circuit, location, 1.0 + float(values[0]))

    return Candidate(
        Cause(NAME, location, signal),
        Span.WINDOW if signal is None else Span.WHOLE,
        terms,
        magnitude,
        parameters,
        plausible=lambda values: values[..., 0] > _ABSURD,
        bounds=(_LEAST, _MOST) if signal is None else (-np.inf, np.inf),
        start=lambda values: np.maximum(values, _LEAST),
        extend=extend if signal is None else None,
    )


def _weight(view: View, signal: str | None) -> Array:
    """What drives the change: air past a plate carries off heat with the root of its speed (laminar flow)."""
    if signal is None:
        return view.ones
    logged = view.signal(signal)
    return np.sqrt(np.maximum(logged, 0.0)) if _is_speed(signal) else logged


def _is_speed(signal: str) -> bool:
    return signal.endswith("_m_s")


def _per_unit(setting: Setting, view: View, signal: str, node: int | None) -> float:
    """The change per unit of the signal, over the record, of one that goes with its weight: least squares of heat."""
    if not _is_speed(signal):
        return 1.0
    loss = setting.loss(view.plant)(view.nodes_degC, view.ambient_degC)
    lost = loss.sum(axis=0) if node is None else loss[node]
    on = lost * view.signal(signal)
    return float((lost * _weight(view, signal)) @ on / max(float(on @ on), 1e-30))


_MOST = 9.0
"""A node that gives off ten times what it did is as warm as the ambient, and hardly tells more from still more."""
_LEAST, _ABSURD = -0.9, -3.0
"""What a regression makes of a node that nothing measures may be too large by far."""


def _resistance(change: float) -> float:
    """The relative change of a resistance whose conductance changes by ``change`` of itself."""
    return 1.0 / (1.0 + max(change, _LEAST)) - 1.0
