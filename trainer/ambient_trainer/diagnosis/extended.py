"""The circuit with effects added, simulated: their heat follows from the simulated temperatures, not the logged.

The plain circuit is exact (modal filters). What the effects add to it, z, follows

    z[k+1] = E z[k] + Phi0 h[k] + Phi1 h[k+1],

h being their heat over the capacitance, which depends on T = T_plain + z; h[k+1] is predicted first, then corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, Found
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import Magnitude
from ambient_trainer.diagnosis.terms import DriftTerm, HeatTerm, SensorTerm
from ambient_trainer.diagnosis.view import View, expected_start, fitted_start, with_measured

Array = NDArray[np.float64]


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
        return self.candidate.magnitude(Found(view, self.values, self.covariance))

    @property
    def sensors(self) -> frozenset[int]:
        """The sensors that it makes doubtful."""
        return self.candidate.faulty


@dataclass(frozen=True)
class Model:
    """A plant and the effects that were added to it."""

    plant: Plant
    effects: tuple[Effect, ...] = ()

    def believed(self) -> frozenset[int]:
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


def view(model: Model, record: Record) -> View:
    """``record`` beside the model's simulation, its start fitted."""
    plant = model.plant
    plain = plant.forced(record.inputs)
    decays = plant.decays(record.samples)
    starts = decays[:, plant.reads]
    expected = expected_start(plant, record)
    start = fitted_start(starts, record.sensors - plain[plant.reads], expected)
    heated = any(isinstance(term, HeatTerm) for effect in model.effects for term in _terms(effect, plant, record))
    added = np.zeros_like(plain)
    for _ in range(_STARTED if model.effects else 1):
        nodes = plain + np.einsum("i,ink->nk", start, decays)
        if heated:
            guess = with_measured(plant, record, nodes + added, model.believed())
            added = _added(model, record, nodes, guess)
        truth = (nodes + added)[plant.reads]
        error = _sensor_errors(model, record, truth)
        move = fitted_start(starts, record.sensors - truth - error, expected - start)
        start = start + move
        # what effects add follows from the start, and the start from that
        if not np.abs(move).max() > _START_DEGC:
            break
    nodes = plain + np.einsum("i,ink->nk", start, decays) + added
    truth = nodes[plant.reads]
    error = _sensor_errors(model, record, truth)
    return View(plant, record, with_measured(plant, record, nodes, model.believed()), truth, error, starts, start)


_STARTED, _START_DEGC = 6, 0.01


def _bare(plant: Plant, record: Record) -> View:
    """A view that holds no more than what terms need to know of a record: its signals and inputs."""
    empty = np.zeros((0, 0))
    return View(plant, record, empty, empty, empty, empty, np.zeros(0))


def _terms(effect: Effect, plant: Plant, record: Record) -> Sequence[HeatTerm | SensorTerm | DriftTerm]:
    return effect.candidate.terms(_bare(plant, record))


@dataclass(frozen=True)
class _Heat:
    """One term's heat: its coefficient times its weight, (N,), and the term."""

    weight: Array
    term: HeatTerm
    onset: int | None
    """Where it begins within the record, if it does."""


def _added(model: Model, record: Record, plain: Array, guess: Array) -> Array:
    """What the effects' heat adds to every node, (n, N); ``guess`` (n, N) is about what the nodes will be.

    Found by iterating over whole runs, which takes a few rounds where the effects are small beside the circuit, or
    else step by step.
    """
    plant = model.plant
    air = _bare(plant, record).ambient_degC
    parts = [
        _Heat(value * effect.window(record) * term.weight, term, effect.begins(record))
        for effect in model.effects
        for value, term in zip(effect.values, _terms(effect, plant, record))
        if isinstance(term, HeatTerm)
    ]
    # a trial may run away: what is not finite is taken for no simulation at all
    with np.errstate(over="ignore", invalid="ignore"):
        added = _iterated(plant, parts, plain, air, guess)
        return _in_small_steps(plant, parts, plain, air) if added is None else added


_ROUNDS, _SHRINKING, _NUDGE_K = 40, 0.85, 0.1
_CLOSE_DEGC = 2e-3


def _iterated(plant: Plant, parts: Sequence[_Heat], plain: Array, air: Array, guess: Array) -> Array | None:
    """Whole runs over and over until nothing changes; None where that does not end.

    What the heat does on average per degree, K, is moved to the circuit's side, so that only its deviation from that is
    iterated: C z' = (G + K) z + q(T) - K z.
    """

    def heat(nodes_degC: Array) -> Array:
        return np.asarray(
            sum(each.weight * each.term.value(nodes_degC, air, plant.period_s, each.onset) for each in parts)
        )

    here = heat(guess)
    feedback = (heat(guess + _NUDGE_K) - here).mean(axis=1) / _NUDGE_K
    if not np.isfinite(feedback).all():
        return None
    held = plant.with_losses(-feedback)
    if held.rates.max() > 0.5 * plant.rates.max():
        feedback = np.minimum(feedback, 0.0)
        held = plant.with_losses(-feedback)
    nodes, added, last = guess, guess - plain, np.inf
    for _ in range(_ROUNDS):
        drive = (heat(nodes) - feedback[:, None] * added) / plant.capacitance[:, None]
        added = held.V @ held.modal(held.W @ drive)
        change = float(np.abs(plain + added - nodes).max())
        nodes = plain + added
        if change < _CLOSE_DEGC:
            return np.asarray(added)
        if not change < _SHRINKING * last:
            return None
        last = change
    return None


def _in_small_steps(plant: Plant, parts: Sequence[_Heat], plain: Array, air: Array) -> Array:
    """Step by step, in finer steps where the samples' own are too coarse for what the effects do."""
    result = _step_by_step(plant, parts, plain, air)
    for fine in _FINER:
        if np.isfinite(result).all() and np.abs(result).max(initial=0.0) < _ABSURD_K:
            break
        at = np.arange((len(air) - 1) * fine + 1) / fine
        whole = np.arange(len(air))
        finer = [
            _Heat(np.interp(at, whole, each.weight), each.term, None if each.onset is None else each.onset * fine)
            for each in parts
        ]
        rows = np.array([np.interp(at, whole, row) for row in plain])
        smaller = replace(plant, period_s=plant.period_s / fine)
        result = _step_by_step(smaller, finer, rows, np.interp(at, whole, air))[:, ::fine]
    return result


_FINER = (5,)
_ABSURD_K = 500.0
_LOOK_EVERY = 20


def _step_by_step(plant: Plant, parts: Sequence[_Heat], plain: Array, air: Array) -> Array:
    a, now, later = plant.modal_weights()
    E, Phi0, Phi1 = ((plant.V * each) @ plant.W for each in (a, now, later))
    held = [None if each.term.memory_s is None else each.term.law(plain[:, 0], air[0]) for each in parts]
    ratios = [0.0 if each.term.memory_s is None else plant.period_s / each.term.memory_s for each in parts]
    kept = [float(np.exp(-ratio)) for ratio in ratios]
    # as in `lag`: straight between samples
    gained = [float(-np.expm1(-ratio) / ratio) if ratio else 1.0 for ratio in ratios]

    def heat(k: int, nodes: Array) -> Array:
        total = np.zeros(len(nodes))
        for each, before, share in zip(parts, held, gained):
            if each.weight[k] != 0.0:
                value = each.term.law(nodes, air[k])
                if before is not None:
                    value = value - before if k in (0, each.onset) else share * value - before
                total += each.weight[k] * value
        return np.asarray(total / plant.capacitance)

    result = np.zeros_like(plain)
    z = np.zeros(len(plain))
    h = heat(0, plain[:, 0])
    for k in range(len(air) - 1):
        for index, each in enumerate(parts):
            before = held[index]
            if before is not None and k + 1 == each.onset:
                held[index] = each.term.law(np.full(len(z), air[k + 1]), air[k + 1])
            elif before is not None:
                value = each.term.law(plain[:, k] + z, air[k])
                now_held = before if k in (0, each.onset) else before + (1.0 - gained[index]) * value
                held[index] = kept[index] * now_held + (gained[index] - kept[index]) * value
        free = E @ z + Phi0 @ h
        predicted = heat(k + 1, plain[:, k + 1] + free + Phi1 @ h)
        z = free + Phi1 @ predicted
        h = heat(k + 1, plain[:, k + 1] + z)
        result[:, k + 1] = z
        if k % _LOOK_EVERY == 0 and not np.abs(z).max() < _ABSURD_K:
            result[:, k + 1 :] = np.nan
            break
    return result


def _sensor_errors(model: Model, record: Record, truth_degC: Array) -> Array:
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
