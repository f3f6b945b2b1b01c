"""The circuit with effects added, simulated: their heat follows from the simulated temperatures, not the logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, Estimate
from ambient_trainer.diagnosis.closed_loop import Loop, Part, closed_loop
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import Magnitude
from ambient_trainer.diagnosis.terms import DriftTerm, HeatTerm, SensorTerm
from ambient_trainer.diagnosis.view import View, expected_start, fitted_start, with_measured

Array = NDArray[np.float64]


WIDER = 2.0
"""What is stated of a number is wider by this than its standard error: a circuit is never quite right, and errs in the
same way all along a record. Over 48 simulated runs with known effects, plain intervals held half of the true sizes."""


@dataclass(frozen=True)
class Effect:
    """A candidate with its coefficients (k,), acting from ``onset_s`` to ``end_s`` (None: the record's own ends)."""

    candidate: Candidate
    onset_s: float | None
    end_s: float | None
    values: Array
    covariance: Array
    known: bool = False
    """It was there in the known-good records, too: it is held, and is no finding."""

    def window(self, record: Record) -> Array:
        """1 where it acts, 0 elsewhere, (N,); a sample that it enters half is 0.5."""
        return windowed(record, self.onset_s) - (0.0 if self.end_s is None else windowed(record, self.end_s))

    def begins(self, record: Record) -> int | None:
        """The index of the first sample in which it acts; None where it has acted before the record."""
        first = int(np.argmax(self.window(record) > 0.0))
        return None if self.onset_s is None or first == 0 else first

    def magnitude(self, view: View) -> Magnitude:
        """How large it is."""
        return self.candidate.magnitude(self.estimate(view))

    def estimate(self, view: View) -> Estimate:
        """Its numbers, and how sure they are."""
        return Estimate(view, self.values, WIDER**2 * self.covariance)

    @property
    def sensors(self) -> frozenset[int]:
        """The sensors that it makes doubtful."""
        return self.candidate.faulty


@dataclass(frozen=True)
class Model:
    """A plant and the effects that were added to it."""

    plant: Plant
    effects: tuple[Effect, ...] = ()

    def trusted_sensors(self) -> frozenset[int]:
        """The sensors that no effect makes doubtful."""
        doubtful = frozenset[int]().union(*(effect.sensors for effect in self.effects if not effect.known))
        return frozenset(range(len(self.plant.reads))) - doubtful

    def with_effect(self, effect: Effect) -> Model:
        """The model with one more effect."""
        return replace(self, effects=(*self.effects, effect))


def windowed(record: Record, onset_s: float | None) -> Array:
    """The share of each sample that lies after ``onset_s``: samples are means over a period."""
    if onset_s is None:
        return np.ones(record.samples)
    return np.clip((record.time_s - onset_s) / record.period_s + 0.5, 0.0, 1.0)


def view(model: Model, record: Record, like: View | None = None) -> View:
    """``record`` beside the model's simulation, its start fitted; ``like`` is that of a model that is much the same."""
    plant = model.plant
    plain = plant.forced(record.inputs)
    decays = plant.decays(record.samples)
    expected = expected_start(plant, record)
    parts = heat_parts(model, plant, record)
    if like is None:
        start = fitted_start(decays[:, plant.reads], record.sensors - plain[plant.reads], expected)
        nodes = plain + np.einsum("i,ink->nk", start, decays)
        nodes = with_measured(plant, record, nodes, model.trusted_sensors()) if parts else nodes
    else:
        start, nodes = like.start, like.model_degC
    air = View.bare(plant, record).ambient_degC
    starts = decays[:, plant.reads]
    # heat follows from the nodes, those from the start, and the start from the heat: all three are moved at once
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_ROUNDS):
            bare = plain + np.einsum("i,ink->nk", start, decays)
            added, closed = closed_loop(plant, parts, nodes, air, bare, decays)
            there = bare + added
            if not np.abs(added).max() < _ABSURD_K:
                nodes = np.full_like(nodes, np.nan)
                break
            truth = there[plant.reads]
            starts = read_by_sensors(model, record, truth, closed[:, plant.reads])
            left = record.sensors - truth - sensor_errors(model, record, truth)
            move = fitted_start(starts, left, expected - start)
            start = start + move
            last, nodes = nodes, there + np.einsum("i,ink->nk", move, closed)
            if np.abs(nodes - last).max() < _CLOSE_DEGC:
                break
    truth = nodes[plant.reads]
    error = sensor_errors(model, record, truth)
    measured = with_measured(plant, record, nodes, model.trusted_sensors())
    return View(plant, record, measured, truth, error, starts, start, nodes)


_ROUNDS, _CLOSE_DEGC, _ABSURD_K = 12, 1e-2, 500.0
"""Samples of a simulation that runs away are not finite."""


def with_feedback(model: Model, record: Record, nodes_degC: Array, along: Array) -> Array:
    """A change ``along`` (c, n, N) of the nodes with what the effects' heat answers to it, about ``nodes_degC``."""
    parts = heat_parts(model, model.plant, record)
    loop = Loop.about(model.plant, parts, nodes_degC, View.bare(model.plant, record).ambient_degC) if parts else None
    return along if loop is None else along + loop.answer(along)


def read_by_sensors(model: Model, record: Record, truth_degC: Array, change: Array) -> Array:
    """What sensors with their faults make of a ``change`` (c, s, N) of what they should read, (s, N)."""
    result = change.copy()
    for effect in model.effects:
        window = effect.window(record)
        for value, term in zip(effect.values, _terms(effect, model.plant, record)):
            if isinstance(term, SensorTerm):
                # every fault is linear in what the sensor should read
                there = truth_degC[term.sensor]
                result[:, term.sensor] += value * window * (term.law(there + change[:, term.sensor]) - term.law(there))
    return result


def _terms(effect: Effect, plant: Plant, record: Record) -> Sequence[HeatTerm | SensorTerm | DriftTerm]:
    return effect.candidate.terms(View.bare(plant, record))


def heat_parts(model: Model, plant: Plant, record: Record) -> list[Part]:
    """The heat of all effects, as it would be in ``plant``."""
    return [
        Part(value * effect.window(record) * term.weight, term, effect.begins(record))
        for effect in model.effects
        for value, term in zip(effect.values, _terms(effect, plant, record))
        if isinstance(term, HeatTerm)
    ]


def sensor_errors(model: Model, record: Record, truth_degC: Array) -> Array:
    """What faulty sensors read beside the truth, (s, N)."""
    error = np.zeros_like(truth_degC)
    for effect in model.effects:
        window = effect.window(record)
        for value, term in zip(effect.values, _terms(effect, model.plant, record)):
            if isinstance(term, SensorTerm):
                error[term.sensor] += value * window * term.law(truth_degC[term.sensor])
            elif isinstance(term, DriftTerm):
                since = record.time_s[0] if effect.onset_s is None else effect.onset_s
                error[term.sensor] += value * np.maximum(0.0, record.time_s - since)
    return error
