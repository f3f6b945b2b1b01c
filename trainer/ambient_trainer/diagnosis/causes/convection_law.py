"""The loss to the ambient is not proportional to the difference: it grows faster, or slower."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Estimate, Parameters, Setting, Span
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm, Law
from ambient_trainer.diagnosis.view import View, conductances_to_ambient

Array = NDArray[np.float64]

_NAME = "convection_law"
_LARGEST_K = 50.0
_LEAST_K = 0.5


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """All nodes alike, and each alone: loss G_i ((1 + a) D + b D |D|) at the difference D to the ambient."""
    for place in setting.to_ambient:
        yield _curved(setting, place)


def _own(plant: Plant, node: int | None) -> Array:
    """The conductances to the ambient of the nodes concerned, (n,)."""
    conductance = conductances_to_ambient(plant)
    return conductance if node is None else np.where(np.arange(len(conductance)) == node, conductance, 0.0)


def _straight(own: Array) -> Law:
    return lambda nodes_degC, ambient_degC: (own * (ambient_degC - nodes_degC).T).T


def _bent(own: Array) -> Law:
    def law(nodes_degC: Array, ambient_degC: Array) -> Array:
        difference = nodes_degC - ambient_degC
        return (-own * (difference * np.abs(difference)).T).T

    return law


def _curved(setting: Setting, node: int | None) -> Candidate:
    def terms(view: View) -> tuple[HeatTerm, ...]:
        own = _own(view.plant, node)
        return HeatTerm(view.ones, _bent(own)), HeatTerm(view.ones, _straight(own))

    def exponent(estimate: Estimate, curve: float) -> float:
        """By how much the exponent of the loss grows with a curvature of ``curve``, the rest re-optimised."""
        plant = estimate.view.plant
        own, before = _own(plant, node), setting.loss(plant)
        bent, straight = _bent(own), _straight(own)
        along = estimate.covariance[0, 1] / max(estimate.covariance[0, 0], 1e-30)
        change = estimate.values[1] + along * (curve - estimate.values[0])

        def after(nodes_degC: Array, ambient_degC: Array) -> Array:
            more = curve * bent(nodes_degC, ambient_degC) + change * straight(nodes_degC, ambient_degC)
            return np.asarray(before(nodes_degC, ambient_degC) - more)

        return _exponent(after, before, estimate.view, own) - _exponent(before, before, estimate.view, own)

    def magnitude(estimate: Estimate) -> Magnitude:
        low, high = sorted(exponent(estimate, each) for each in estimate.interval(0))
        meaning = f"change of n, where the loss of {setting.named(node)} goes with the difference to the power 1 + n:"
        return Magnitude(exponent(estimate, float(estimate.values[0])), "1", meaning, (low, high))

    def parameters(estimate: Estimate) -> Parameters:
        curvature, change = map(float, estimate.values)
        return {"curvature": (curvature, "1/K"), "conductance_change": (change, "1")}

    location = None if node is None else setting.plant.nodes[node]
    return Candidate(
        Cause(_NAME, location),
        Span.WINDOW,
        terms,
        magnitude,
        parameters,
        # where the resistances are free, they absorb a change of all losses alike
        fixed=(None, 0.0 if setting.circuit_is_free else None),
        plausible=_always_a_loss,
    )


def _always_a_loss(values: Array) -> NDArray[np.bool_]:
    """Heat flows from warm to cold at every difference that a device sees."""
    straight = 1.0 + values[..., 1]
    return np.asarray((straight > 0.02) & (straight + _LARGEST_K * values[..., 0] > 0.02))


def _exponent(loss: Law, weighing: Law, view: View, own: Array) -> float:
    """The slope of ln(loss) over ln(difference), a factor a node being free, weighted by the square of ``weighing``."""
    losing = own > 0
    difference = np.abs(view.nodes_degC - view.ambient_degC)[losing]
    lost = np.abs(loss(view.nodes_degC, view.ambient_degC))[losing]
    weight = weighing(view.nodes_degC, view.ambient_degC)[losing] ** 2
    weight[(difference < _LEAST_K) | (lost <= 0.0)] = 0.0
    x, y = np.log(np.maximum(difference, _LEAST_K)), np.log(np.maximum(lost, 1e-12))
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    x, y = x - (weight * x).sum(axis=1, keepdims=True) / total, y - (weight * y).sum(axis=1, keepdims=True) / total
    return float((weight * x * y).sum() / max(float((weight * x * x).sum()), 1e-30))


KIND = CauseKind(
    _NAME,
    "a loss that is not proportional to the difference to the ambient",
    "the loss from {place} is not proportional to the difference to the ambient",
    _candidates,
    lambda cause: "a loss in a circuit is proportional to its difference",
    rank=40,
    built_in=True,
    bends_loss=True,
)
