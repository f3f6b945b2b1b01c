"""A term is one thing that may be missing, linear in its coefficient: heat into nodes, or an error of a sensor.

With the temperatures that were measured in place of the unknown true ones, what a term does to every sensor is known
before its coefficient is: candidates are compared by linear regression, and only the best are simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.view import View
from ambient_trainer.lti.lag import lagged

Array = NDArray[np.float64]

Law = Callable[[Array, Array], Array]
"""Of all nodes' temperatures, (n, ...), and the ambient's, (...), to the heat into each node, (n, ...), in W."""


@dataclass(frozen=True)
class HeatTerm:
    """Heat into nodes: coefficient times ``weight`` (N,) times ``law``.

    With ``lag_s`` it is the law's value less its own first-order lag: what flows into a hidden mass, which has long
    been there at a record's start, but comes at the ambient's temperature where it is attached later.
    """

    weight: Array
    law: Law
    lag_s: float | None = None

    def value(self, nodes_degC: Array, ambient_degC: Array, period_s: float, onset: int | None = None) -> Array:
        """The law over a whole run, less its lag where there is one, (n, N), from the index ``onset`` on."""
        value = self.law(nodes_degC, ambient_degC)
        if self.lag_s is None:
            return value
        if onset is None:
            return value - lagged(value, self.lag_s, period_s)
        result = np.zeros_like(value)
        apart = self.apart(nodes_degC.shape[0], ambient_degC)[:, onset, None]
        result[:, onset:] = value[:, onset:] - lagged(value[:, onset:], self.lag_s, period_s, apart)
        return result

    def apart(self, count: int, ambient_degC: Array) -> Array:
        """The law where all of ``count`` nodes are as warm as the ambient, (n, N)."""
        return self.law(np.broadcast_to(ambient_degC, (count, *ambient_degC.shape)), ambient_degC)

    def heat_W(self, nodes_degC: Array, ambient_degC: Array, period_s: float) -> Array:
        """Per unit of the coefficient, (n, N)."""
        return np.asarray(self.weight * self.value(nodes_degC, ambient_degC, period_s))


@dataclass(frozen=True)
class SensorTerm:
    """What one sensor adds to the truth: coefficient times ``law`` of what it should read, (N,) to (N,)."""

    sensor: int
    law: Callable[[Array], Array]


@dataclass(frozen=True)
class DriftTerm:
    """What one sensor adds to the truth: coefficient, in K/s, times the time since the onset."""

    sensor: int


Term = HeatTerm | SensorTerm | DriftTerm


def into(node: int, count: int, law: Law) -> Law:
    """The law of the heat into one of ``count`` nodes, ``law`` being one number at each time."""

    def placed(nodes_degC: Array, ambient_degC: Array) -> Array:
        value = np.zeros((count, *ambient_degC.shape))
        value[node] = law(nodes_degC, ambient_degC)
        return value

    return placed


def beginning(view: View, term: Term, onsets_s: Sequence[float | None]) -> Array:
    """What ``term`` adds to each sensor if it begins at each of ``onsets_s`` (None: at the start), (onsets, s, N).

    Between two samples it is drawn straight: a sample is a mean over its period.
    """
    return _between(view, onsets_s, lambda whole: responses(view, term, whole))


def ending(view: View, term: Term, ends_s: Sequence[float | None]) -> Array:
    """What ``term`` no longer adds if it ends at each of ``ends_s``: as :func:`beginning`, but nothing begins anew."""
    if isinstance(term, HeatTerm) and term.lag_s is not None:
        return _between(view, ends_s, lambda whole: _heated(view, term, whole))
    return beginning(view, term, ends_s)


def _between(view: View, onsets_s: Sequence[float | None], at_samples: Callable[[list[int]], Array]) -> Array:
    time_s, period = view.record.time_s, view.record.period_s
    position = [
        0.0 if each is None else min(max((each - time_s[0]) / period + 0.5, 0.0), float(len(time_s)))
        for each in onsets_s
    ]
    whole = sorted({int(each) for each in position} | {int(np.ceil(each)) for each in position})
    at = dict(zip(whole, at_samples(whole)))
    share = [each - int(each) for each in position]
    rows = [
        at[int(each)] if not part else (1 - part) * at[int(each)] + part * at[int(each) + 1]
        for each, part in zip(position, share)
    ]
    return np.array(rows)


def responses(view: View, term: Term, onsets: Sequence[int]) -> Array:
    """What ``term`` adds to each sensor if it begins at each of ``onsets`` (indices), shape (onsets, s, N)."""
    if isinstance(term, HeatTerm):
        settled = _heated(view, term, onsets)
        return settled if term.lag_s is None else settled + _warming_up(view, term, term.lag_s, onsets)
    count = view.record.samples
    result = np.zeros((len(onsets), len(view.plant.reads), count))
    steady = term.law(view.truth_degC[term.sensor]) if isinstance(term, SensorTerm) else None
    for index, onset in enumerate(onsets):
        ramp = view.plant.period_s * np.arange(count - onset)
        result[index, term.sensor, onset:] = ramp if steady is None else steady[onset:]
    return result


def _heated(view: View, term: HeatTerm, onsets: Sequence[int]) -> Array:
    plant, count = view.plant, view.record.samples
    result = np.zeros((len(onsets), len(plant.reads), count))
    heat = term.heat_W(view.nodes_degC, view.ambient_degC, plant.period_s)
    drive = plant.W @ (heat / plant.capacitance[:, None])
    modal = plant.modal(drive)
    # a sample is a mean over its period: heat that begins with one has grown to it since the one before
    grown = plant.modal_weights()[2][:, None] * drive
    grown[:, 0] = 0.0
    seen = plant.V[plant.reads]
    powers = plant.modal_decay(count)
    for index, onset in enumerate(onsets):
        if onset < count:
            # what each mode held by the onset is taken out again
            before = modal[:, onset] - grown[:, onset]
            left = modal[:, onset:] - before[:, None] * powers[:, : count - onset]
            result[index, :, onset:] = seen @ left
    return result


def _warming_up(view: View, term: HeatTerm, lag_s: float, onsets: Sequence[int]) -> Array:
    """What a mass takes up besides because it comes at the ambient's temperature, not at that it would have had."""
    plant, count, air = view.plant, view.record.samples, view.ambient_degC
    result = np.zeros((len(onsets), len(plant.reads), count))
    value = term.law(view.nodes_degC, air)
    missing = lagged(value, lag_s, plant.period_s) - term.apart(len(value), air)
    decay = np.exp(-plant.period_s * np.arange(count) / lag_s)
    powers = plant.modal_decay(count)
    unit = plant.modal(np.broadcast_to(decay, powers.shape)) + plant.modal_weights()[2][:, None] * powers
    seen = plant.V[plant.reads]
    for index, onset in enumerate(onsets):
        if 0 < onset < count:
            drive = plant.W @ (term.weight[onset] * missing[:, onset] / plant.capacitance)
            result[index, :, onset:] = seen @ (drive[:, None] * unit[:, : count - onset])
    return result
