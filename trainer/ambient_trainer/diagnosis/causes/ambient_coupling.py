"""The resistance to the ambient changed: a case, a fan, wind; of one node, or of all alike."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.addition import with_ambient_conductance
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Estimate, Setting, Span, per
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

_NAME = "ambient_coupling"
_MOST = 9.0
"""A node that gives off ten times its loss is as warm as the ambient, and hardly shows more."""
_LEAST, _ABSURD = -0.9, -3.0
"""A regression may overestimate the change at a node without a sensor by far."""


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """All nodes alike, and each that is joined to the ambient; by nothing logged and by every signal."""
    for place in setting.to_ambient:
        for signal in (None, *setting.signals):
            yield _changed(setting, place, signal)


def _changed(setting: Setting, node: int | None, signal: str | None) -> Candidate:
    """A relative change g of the conductances: each node gives off g times its loss more."""
    location = None if node is None else setting.plant.nodes[node]

    def terms(view: View) -> tuple[HeatTerm, ...]:
        loss, nodes = setting.loss(view.plant), np.arange(len(view.plant.nodes))
        affected = np.ones(len(nodes)) if node is None else nodes == node

        def law(nodes_degC: Array, ambient_degC: Array) -> Array:
            return -(affected * loss(nodes_degC, ambient_degC).T).T

        return (HeatTerm(_weight(view, signal), law),)

    def magnitude(estimate: Estimate) -> Magnitude:
        scale = 1.0 if signal is None else _per_unit(setting, estimate.view, signal, node)
        low, high = sorted(_resistance(end) for end in estimate.interval(0, scale))
        value, unit = _resistance(scale * float(estimate.values[0])), "1" if signal is None else per("1", signal)
        meaning = f"relative change of the resistance from {setting.named(node)} to the ambient"
        return Magnitude(value, unit, meaning, (low, high))

    def extend(circuit: Circuit, values: Array) -> Circuit:
        return with_ambient_conductance(circuit, location, 1.0 + float(values[0]))

    return Candidate(
        Cause(_NAME, location, signal),
        Span.WINDOW if signal is None else Span.WHOLE,
        terms,
        magnitude,
        lambda estimate: {"conductance_change": (float(estimate.values[0]), "1")},
        plausible=lambda values: values[..., 0] > _ABSURD,
        bounds=(_LEAST, _MOST) if signal is None else (-np.inf, np.inf),
        start=lambda values: np.maximum(values, _LEAST),
        extend=extend if signal is None else None,
    )


def _weight(view: View, signal: str | None) -> Array:
    """The driver of the change: laminar flow past a plate carries off heat with the root of its speed."""
    if signal is None:
        return view.ones
    logged = view.signal(signal)
    return np.sqrt(np.maximum(logged, 0.0)) if _is_speed(signal) else logged


def _is_speed(signal: str) -> bool:
    return signal.endswith("_m_s")


def _per_unit(setting: Setting, view: View, signal: str, node: int | None) -> float:
    """The change per unit of the signal that is nearest to one by its weight: least squares of the heat."""
    if not _is_speed(signal):
        return 1.0
    loss = setting.loss(view.plant)(view.nodes_degC, view.ambient_degC)
    lost = loss.sum(axis=0) if node is None else loss[node]
    on = lost * view.signal(signal)
    return float((lost * _weight(view, signal)) @ on / max(float(on @ on), 1e-30))


def _resistance(change: float) -> float:
    """The relative change of a resistance whose conductance changes by ``change`` of itself."""
    return 1.0 / (1.0 + max(change, _LEAST)) - 1.0


KIND = CauseKind(
    _NAME,
    "a changed resistance to the ambient",
    "the resistance from {place} to the ambient changed",
    _candidates,
    lambda cause: f"a resistance of a circuit is constant: it cannot follow {cause.signal}",
    rank=20,
    built_in=True,
)
