"""Magnitudes by cause, in the terms of a diagnosis: averages of the physics that ran over the time it was in force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.additions import TERMS, Added
from ambient_trainer.simulator.constants import NODES
from ambient_trainer.simulator.effects.effect import Hidden
from ambient_trainer.simulator.effects.physics import Setting, affected
from ambient_trainer.simulator.effects.sensors import GAIN_REFERENCE_DEGC, clock_ahead, drifted_h
from ambient_trainer.simulator.heat import HeatBalance
from ambient_trainer.simulator.run import Driven

Array = NDArray[np.float64]

_LEAST_DIFFERENCE_K = 1.0
_THERE = 0.5


@dataclass(frozen=True)
class Ran:
    """One effect in the run that went through it; arrays over all samples, also those before the recording."""

    hidden: Hidden
    setting: Setting
    driven: Driven
    added: Added
    """By the effect alone."""
    all_added: Added
    """By all effects of the run."""
    trace: Trace
    random: Callable[[], np.random.Generator]
    """The effect's own random numbers, from their beginning."""

    @property
    def there(self) -> NDArray[np.bool_]:
        """Where the recording has the effect in force: with an on/off signal while that is on."""
        there = (self.setting.share(self.hidden) > _THERE) & (self.setting.time_s > -1e-9)
        signal = self.hidden.signal
        return there & (self.setting.signals[signal] > 0.0) if signal else there

    @property
    def air_degC(self) -> Array:
        """The air, shape (n,)."""
        return self.driven.run.air_degC


Figure = tuple[float, str, dict[str, tuple[float, str]]]
"""Magnitude, its unit, further figures by name."""


def _heat(ran: Ran, added: Added) -> Array:
    """Heat into every node by terms along the run, shape (n, nodes)."""
    balance = HeatBalance([ran.driven.run.phone])
    heat = np.zeros((len(ran.air_degC), len(NODES)))
    for term in added.terms:
        heat += term.course[:, None] * term.pattern * TERMS[term.kind](ran.driven.nodes_degC, ran.air_degC, balance)
    return heat


def _losses(ran: Ran) -> tuple[Array, Array]:
    """What the affected nodes lose to the ambient with the effect and without it, shape (n, affected)."""
    places = [NODES.index(node) for node in affected(ran.hidden.location)]
    own = HeatBalance([ran.driven.run.phone]).lost(ran.driven.nodes_degC, ran.air_degC)
    surfaces = Added(tuple(term for term in ran.all_added.terms if term.kind not in ("steady", "ohmic")))
    with_it = own - _heat(ran, surfaces)
    return with_it[:, places], (with_it + _heat(ran, ran.added))[:, places]


def _slope(values: Array, on: Array) -> float:
    """Least squares through the origin."""
    return float(values @ on / (on @ on)) if on.any() else 0.0


def _heat_source(ran: Ran) -> Figure:
    into = _heat(ran, ran.added).sum(axis=1)[ran.there]
    signal = ran.hidden.signal
    mean_W = (float(into.mean()), "W")
    if signal is None or signal.endswith("_on"):
        return *mean_W, {"peak_W": (float(into.max()), "W")}
    logged = ran.setting.signals[signal][ran.there]
    if signal.endswith("_A"):
        at_25_degC = (ran.hidden.amount, "W/A^2")
        return _slope(into, logged**2), "W/A^2", {"mean_W": mean_W, "at_25_degC": at_25_degC}
    return _slope(into, logged), "W per W/m2", {"mean_W": mean_W}


def _ambient_coupling(ran: Ran) -> Figure:
    """Of the conductance that is with the effect, by least squares over the loss that would be without it."""
    with_it, without = (loss[ran.there].sum(axis=1) for loss in _losses(ran))
    change = _slope(with_it - without, without)
    others = {"conductance_change": (change, "1")}
    if ran.hidden.signal is None or ran.hidden.signal.endswith("_on"):
        return _resistance(change), "1", others
    per_unit = _slope(with_it - without, without * ran.setting.signals[ran.hidden.signal][ran.there])
    others["conductance_change_per_unit"] = (per_unit, "1 per m/s")
    others["mean_resistance_change"] = (_resistance(change), "1")
    return _resistance(per_unit), "1 per m/s", others


def _resistance(change: float) -> float:
    """The relative change of a resistance whose conductance changes by ``change`` of itself."""
    return 1.0 / (1.0 + change) - 1.0


def _contact(ran: Ran) -> Figure:
    touching = [link for link in ran.added.links if link.other in NODES]
    if not touching:
        return 0.0, "degC", {}
    index = len(NODES) + [body.name for body in ran.all_added.bodies].index(touching[0].one)
    body = ran.driven.bodies_degC[:, index - len(NODES)][ran.there]
    nodes = ran.driven.nodes_degC[ran.there]
    conductances = np.array([link.conductance_W_K[ran.there] for link in touching])
    nodes_degC = np.array([nodes[:, NODES.index(link.other)] for link in touching])
    flow = (conductances * (body - nodes_degC)).sum(axis=0)
    total = conductances.sum(axis=0)
    held = ran.setting.share(ran.hidden)[ran.there] > 1.0 - 1e-9
    touched = (conductances * nodes_degC).sum(axis=0)[held] / total[held]
    design = np.column_stack([np.ones_like(touched), -touched])
    (offset, conductance), *_ = np.linalg.lstsq(design, flow[held], rcond=None)
    return (
        float(body.mean()),
        "degC",
        {
            "conductance_W_K": (float(total.mean()), "W/K"),
            "equivalent_W_K": (float(conductance), "W/K"),
            "equivalent_degC": (float(offset / conductance) if conductance else 0.0, "degC"),
        },
    )


def _convection_law(ran: Ran) -> Figure:
    """The exponents by a regression over all affected nodes, each with a factor of its own, the losses its weights."""
    places = [NODES.index(node) for node in affected(ran.hidden.location)]
    difference = (ran.driven.nodes_degC[:, places] - ran.air_degC[:, None])[ran.there]
    with_it, without = (loss[ran.there] for loss in _losses(ran))
    far = (np.abs(difference) > _LEAST_DIFFERENCE_K) & (with_it * without > 0.0)
    if not far.any():
        return 0.0, "1", {}
    exponents = [_exponent(difference, loss, far, without) for loss in (with_it, without)]
    bends = [_curvature(difference, loss) for loss in (with_it, without)]
    return (
        exponents[0] - exponents[1],
        "1",
        {
            "exponent_with": (exponents[0] - 1.0, "1"),
            "exponent_without": (exponents[1] - 1.0, "1"),
            "curvature_with": (bends[0], "1/K"),
            "curvature_without": (bends[1], "1/K"),
        },
    )


def _exponent(difference: Array, loss: Array, far: NDArray[np.bool_], weight: Array) -> float:
    """Of |loss| ~ |difference|^e, shape (n, nodes) each, where ``far``; a factor a node is free."""
    weight = np.where(far, weight**2, 0.0)
    x, y = (np.log(np.where(far, np.abs(each), 1.0)) for each in (difference, loss))
    total = np.maximum(weight.sum(axis=0), 1e-300)
    x, y = x - (weight * x).sum(axis=0) / total, y - (weight * y).sum(axis=0) / total
    return float((weight * x * y).sum() / (weight * x * x).sum())


def _curvature(difference: Array, loss: Array) -> float:
    """b of loss ~ a (difference + b difference |difference|), with an a for each node, shape (n, nodes) each."""
    sums = np.zeros(2)
    for one, lost in zip(difference.T, loss.T):
        (linear, bent), *_ = np.linalg.lstsq(np.column_stack([one, one * np.abs(one)]), lost, rcond=None)
        sums += np.array([linear * bent, linear**2]) * (one**4).sum()
    return float(sums[0] / sums[1])


def _thermal_mass(ran: Ran) -> Figure:
    capacity = sum(body.capacity_J_K for body in ran.added.bodies)
    clamp = ran.added.links[0].conductance_W_K[ran.there].mean() if ran.added.links else 0.0
    return capacity, "J/K", {"conductance_W_K": (float(clamp), "W/K")}


def _path(ran: Ran) -> Figure:
    halves = [link.conductance_W_K[ran.there] for link in ran.added.links if link.other in NODES]
    series = 1.0 / (1.0 / halves[0] + 1.0 / halves[1]) if halves else np.zeros(1)
    return float(series.mean()), "W/K", {}


def _bias(ran: Ran) -> Figure:
    return float(ran.hidden.amount * ran.setting.share(ran.hidden, 90.0)[ran.there].mean()), "degC", {}


def _gain(ran: Ran) -> Figure:
    return ran.hidden.amount, "1", {"reference_degC": (GAIN_REFERENCE_DEGC, "degC")}


def _lag(ran: Ran) -> Figure:
    return ran.hidden.amount, "s", {}


def _stuck(ran: Ran) -> Figure:
    reading = ran.trace.columns[f"{ran.hidden.location}_degC"][ran.there[ran.driven.run.unrecorded :]]
    return float(np.median(reading)), "degC", {}


def _drift(ran: Ran) -> Figure:
    drifted_K = ran.hidden.amount * drifted_h(ran.hidden, ran.setting)[ran.there]
    since_h = (ran.setting.time_s[ran.there] - ran.setting.lasting(ran.hidden)[0]) / 3600.0
    return _slope(drifted_K, since_h), "K/h", {"at_the_end_K": (float(drifted_K[-1]), "K")}


def _clock(ran: Ran) -> Figure:
    return float(clock_ahead(ran.hidden, ran.setting, ran.random())[ran.there].mean()), "s", {}


FIGURES: dict[str, Callable[[Ran], Figure]] = {
    "heat_source": _heat_source,
    "ambient_coupling": _ambient_coupling,
    "contact": _contact,
    "convection_law": _convection_law,
    "thermal_mass": _thermal_mass,
    "path": _path,
    "sensor_bias": _bias,
    "sensor_gain": _gain,
    "sensor_lag": _lag,
    "sensor_stuck": _stuck,
    "sensor_drift": _drift,
    "clock_offset": _clock,
}
"""By cause; where an effect is never in force there is none."""
