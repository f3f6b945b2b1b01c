"""What candidates are made of: signals that vary, sensors that stood still, and whether watts are known."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.candidate import Setting
from ambient_trainer.diagnosis.causes import kind_of
from ambient_trainer.diagnosis.model import Model
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.terms import HeatTerm, Law
from ambient_trainer.diagnosis.view import View, conductances_to_ambient

Array = NDArray[np.float64]

_VARIES = 0.1
_STILL_DEGC = 0.15
_MOVED_DEGC = 1.0
_STILL_SAMPLES = 30


def setting_of(model: Model, views: Sequence[View], circuit_is_free: bool = False) -> Setting:
    """The setting of a diagnosis."""
    plant = model.plant
    names = [name for name in views[0].signals if all(name in view.signals for view in views)]
    varying = tuple(name for name in names if any(_varies(view.signals[name]) for view in views))
    still = tuple(_longest_still(views, sensor) for sensor in range(len(plant.reads)))
    return Setting(plant, varying, heat_in_watts(plant.circuit), loss_of(model, views[0]), still, circuit_is_free)


def _varies(signal: Array) -> bool:
    """Whether it varies enough to drive anything: a signal that hardly leaves its mean acts as a constant."""
    return bool(np.nanmax(signal) - np.nanmin(signal) > _VARIES * np.nanmax(np.abs(signal)))


def loss_of(model: Model, view: View) -> Callable[[Plant], Law]:
    """The loss to the ambient by the circuit's resistances, bent as known-good records have shown it to be."""
    bends = [
        (float(value), term.law)
        for effect in model.effects
        if effect.known and kind_of(effect.candidate.cause).bends_loss
        for value, term in zip(effect.values, effect.candidate.terms(view))
        if isinstance(term, HeatTerm)
    ]

    def of(plant: Plant) -> Law:
        conductance = conductances_to_ambient(plant)

        def loss(nodes_degC: Array, ambient_degC: Array) -> Array:
            straight = (conductance * (nodes_degC - ambient_degC).T).T
            return np.asarray(straight - sum(value * law(nodes_degC, ambient_degC) for value, law in bends))

        return loss

    return of


def heat_in_watts(circuit: Circuit) -> bool:
    """Whether something fixed sets the scale of heat: temperatures alone determine only heat over capacitance."""
    fixed = {each.name for each in circuit.parameters if not each.free}
    # a share that was given in watts for a load does as well; the default of one does for a power only
    values = {each.name: each.initial for each in circuit.parameters}
    named = [each.share for each in circuit.sources if each.signal.endswith("_W") or values[each.share] != 1.0]
    named += [str(node.capacitance) for node in circuit.states]
    named += [edge.resistance for edge in circuit.edges]
    return any(name in fixed for name in named)


def _longest_still(views: Sequence[View], sensor: int) -> tuple[float | None, float | None] | None:
    found = [each for view in views for each in [_still(view, sensor)] if each is not None]
    return max(found, key=lambda each: each[0])[1] if found else None


def _still(view: View, sensor: int) -> tuple[int, tuple[float | None, float | None]] | None:
    """The samples and the times of the longest stretch in which readings stay while the simulation moves."""
    read, truth = view.record.sensors[sensor], view.truth_degC[sensor]
    time_s, half = view.record.time_s, view.record.period_s / 2
    first, longest = 0, (0, 0)
    low = high = float("nan")
    for index, value in enumerate(read):
        low, high = float(np.fmin(low, value)), float(np.fmax(high, value))
        if high - low > _STILL_DEGC:
            first, low, high = _restarted(read, index)
        if index + 1 - first > longest[1] - longest[0]:
            longest = (first, index + 1)
    start, stop = longest
    if stop - start < _STILL_SAMPLES or np.ptp(truth[start:stop]) < _MOVED_DEGC:
        return None
    onset = None if start == 0 else float(time_s[start] - half)
    return stop - start, (onset, None if stop == len(read) else float(time_s[stop - 1] + half))


def _restarted(read: Array, index: int) -> tuple[int, float, float]:
    """The earliest start before ``index`` from which the readings still lie together, and their range."""
    first = index
    low = high = float(read[index])
    while first > 0 and not max(high, read[first - 1]) - min(low, read[first - 1]) > _STILL_DEGC:
        first -= 1
        low, high = min(low, float(read[first])), max(high, float(read[first]))
    return first, low, high
