"""The joint fit of starts, circuit parameters and the effects' coefficients.

One step (Gauss-Newton) solves the linear problem about the model and simulates again. The same normal equations less
those of a block of time give the fit without it: by that the gain on held-out data is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.circuit_parameters import Change, bounded, changed, moved_to, traded
from ambient_trainer.diagnosis.effect_parameters import EffectParameter, Kind, moved, unknowns, within
from ambient_trainer.diagnosis.model import Model, view
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.prior import Prior
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.sensitivities import columns
from ambient_trainer.diagnosis.view import View
from ambient_trainer.estimation.least_squares import scaled_solution
from ambient_trainer.estimation.noise import ORDER, Noise
from ambient_trainer.estimation.validation import time_blocks

Array = NDArray[np.float64]

FOLDS = 5
_BLOCKS, _CLUSTERS = 50, 12
_RIDGE, _HELD = 1e-9, 1e-6
_SETTLED = 1e-3
_BOUNDS = 8
_AS_PROMISED = 0.5
_MOST_DAMPING = 300.0


@dataclass(frozen=True)
class TrainingSet:
    """What a model is fitted to: records, the noise they are whitened by, and the circuit's parameters to search.

    ``prior`` says what is known of them, and of the coefficients of the effects that are ``known``.
    """

    records: tuple[Record, ...]
    noise: Noise
    searched: tuple[str, ...] = ()
    prior: Prior | None = None

    def free(self, model: Model) -> tuple[EffectParameter, ...]:
        """What is fitted of a model's effects."""
        return unknowns(model, self.prior is not None)


@dataclass(frozen=True)
class FitResult:
    """A model, its views, and per record the errors (s, N) on blocks that its coefficients have not seen."""

    model: Model
    views: tuple[View, ...]
    held_out_degC: tuple[Array, ...]
    square: float
    """Of the whitened errors on held-out blocks."""

    @property
    def longest(self) -> View:
        """The view of the longest record."""
        return max(self.views, key=lambda each: each.record.samples)


def blocks(record: Record) -> NDArray[np.intp]:
    """The block of time that each sample lies in, (N,); every fifth is held out together."""
    return time_blocks(record.samples, _BLOCKS, 4 * ORDER)


def fit_model(model: Model, training: TrainingSet, rounds: int) -> FitResult:
    """``model`` with all that is free in it fitted in so many steps, each taken only as far as it helps."""
    views = _views(model, training)
    square = _square(model, views, training)
    damping = _RIDGE
    system = None
    for _ in range(rounds if np.isfinite(square) else 0):
        system = system or _System.of(model, views, training)
        before = square
        while damping <= _MOST_DAMPING:
            after, tried, there = system.best(model, system.solution(model, damping), square)
            if after < square:
                model, views, square, system = tried, there, after, None
                break
            damping *= 30.0
        if square > (1.0 - _SETTLED) * before:
            break
        damping = max(_RIDGE, damping / 30.0)
    if not np.isfinite(square):
        return FitResult(model, tuple(views), tuple(each.residual_degC for each in views), np.inf)
    system = system or _System.of(model, views, training)
    held_out = system.held_out()
    model = system.with_covariance(model)
    errors = tuple(_whitened_square(each, training.noise) for each in held_out)
    return FitResult(model, tuple(views), held_out, float(sum(errors)))


def objective(model: Model, training: TrainingSet) -> float:
    """The objective of the fit: the whitened square and the penalty of the prior."""
    return _square(model, _views(model, training), training)


def nuisance_columns(current: FitResult, training: TrainingSet) -> tuple[list[Array], tuple[Array, Array] | None]:
    """Per view what all that is free does to the sensors, (c, s, N); and the prior's rows, (c, u), and what is off."""
    system = _System.of(current.model, current.views, training)
    found = [each[system.first :] for each in system.columns]
    if training.prior is None:
        return found, None
    rows, off = training.prior.rows(current.model, system.factor)
    known = np.zeros((len(found[0]), len(off)))
    known[: rows.shape[1]] = rows.T
    return found, (known, off)


def information(model: Model, training: TrainingSet) -> Array:
    """Of all free unknowns but the starts, (u, u): the inverse of their covariance."""
    system = _System.of(model, _views(model, training), training)
    return _inverse(system.covariance()[system.first :, system.first :])


def _views(model: Model, training: TrainingSet) -> list[View]:
    return [view(model, record) for record in training.records]


def _square(model: Model, views: Sequence[View], training: TrainingSet) -> float:
    if not all(np.isfinite(each.simulated_degC).all() for each in views):
        return np.inf
    own = sum(_whitened_square(each.residual_degC, training.noise) for each in views)
    return own if training.prior is None else own + training.prior.square(model)


def _whitened_square(residual: Array, noise: Noise) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(np.nansum(noise.white(residual) ** 2))
    return square if np.isfinite(square) else np.inf


@dataclass(frozen=True)
class _System:
    """Columns per view (c, s, N): all views' starts, the searched parameters, the effects' free coefficients."""

    views: Sequence[View]
    training: TrainingSet
    columns: list[Array]
    unknowns: tuple[EffectParameter, ...]
    parts: tuple[Array, Array]
    """Per fold the normal matrix (f, c, c) and its right-hand side (f, c)."""
    held: tuple[Array, Array]
    """What the prior adds to both, (c, c) and (c,)."""
    factor: float
    """By how much harder the prior holds than it knows."""

    @staticmethod
    def of(model: Model, views: Sequence[View], training: TrainingSet) -> _System:
        free = training.free(model)
        found = [columns(model, training.searched, free, each) for each in views]
        own = []
        for index, (each, inner) in enumerate(zip(views, found)):
            starts = [
                other.starts if index == there else np.zeros((len(other.starts), *each.truth_degC.shape))
                for there, other in enumerate(views)
            ]
            own.append(np.concatenate([*starts, inner]))
        parts = _normal(views, training.noise, own)
        first = sum(len(each.starts) for each in views)
        held, factor = (np.zeros_like(parts[0][0]), np.zeros_like(parts[1][0])), 1.0
        if training.prior is not None:
            factor = training.prior.factor(model, parts[0].sum(axis=0), parts[1].sum(axis=0), first)
            known, pull = training.prior.normal(model, factor)
            held[0][first : first + len(pull), first : first + len(pull)] = known
            held[1][first : first + len(pull)] = pull
        return _System(views, training, own, free, parts, held, factor)

    @property
    def first(self) -> int:
        """Where the starts end."""
        return len(self.columns[0]) - len(self.unknowns) - len(self.training.searched)

    def _all(self) -> tuple[Array, Array]:
        return self.parts[0].sum(axis=0) + self.held[0], self.parts[1].sum(axis=0) + self.held[1]

    def solution(self, model: Model, damping: float) -> Array:
        """The step to the least squares of all rows, held back by ``damping`` (Marquardt 1963) and by bounds."""
        matrix, side = self._all()
        step = scaled_solution(matrix, side, damping)
        stopped = np.zeros(len(step), dtype=bool)
        for _ in range(_BOUNDS):
            allowed = self._allowed(model, step)
            beyond = ~np.isclose(allowed, step, rtol=1e-6, atol=1e-12)
            if not beyond.any():
                break
            # what a bound holds must not be counted on: the others do without
            step = allowed
            stopped |= beyond
            rest = ~stopped
            left = side[rest] - matrix[np.ix_(rest, stopped)] @ step[stopped]
            step[rest] = scaled_solution(matrix[np.ix_(rest, rest)], left, damping)
        return self._allowed(model, step)

    def _allowed(self, model: Model, step: Array) -> Array:
        """As much of ``step`` as the bounds of each unknown allow."""
        result, searched, first = step.copy(), self.training.searched, self.first
        for index, name in enumerate(searched, start=first):
            result[index] = moved_to(model.plant, name, bounded(model.plant, name, float(step[index])))
        for index, each in enumerate(self.unknowns, start=first + len(searched)):
            result[index] = within(model.effects[each.effect], each, float(step[index]), model.plant.period_s)
        return result

    def held_out(self) -> tuple[Array, ...]:
        """Per view the residual (s, N) with coefficients that have not seen the sample's block."""
        # the start of a run, and the onset of an effect, belong to the run: no other block determines them
        edges = [each.kind in (Kind.ONSET, Kind.END) for each in self.unknowns]
        learned = np.flatnonzero(
            np.r_[np.ones(len(self.columns[0]) - len(edges), dtype=bool), ~np.array(edges, dtype=bool)]
        )
        learned = learned[learned >= self.first]
        matrix, side = self._all()
        matrix, side = matrix[np.ix_(learned, learned)], side[learned]
        whole = scaled_solution(matrix, side, _HELD)
        folds = [
            scaled_solution(matrix - own[np.ix_(learned, learned)], side - part[learned], _HELD)
            for own, part in zip(*self.parts)
        ]
        result = []
        for each, own in zip(self.views, self.columns):
            fold = blocks(each.record) % FOLDS
            error = each.residual_degC.copy()
            for index, found in enumerate(folds):
                mine = fold == index
                # what is left to gain on all rows is no gain of a fold
                error[:, mine] -= np.einsum("c,csk->sk", found - whole, own[learned][:, :, mine])
            result.append(error)
        return tuple(result)

    def best(self, model: Model, step: Array, square: float) -> tuple[float, Model, list[View]]:
        """The square, the model and its views after ``step`` from ``square``.

        Where it does not gain what straight lines promise, the better of two ways that are alike where a step is short:
        what trades one conductance for another is straight in conductances, what is relative to them in logarithms.
        """
        matrix, side = self._all()
        promised = float(2.0 * side @ step - step @ matrix @ step)
        end = self._end(model, step, changed)
        if square - end[0] >= _AS_PROMISED * promised or not self.training.searched:
            return end
        return min(end, self._end(model, step, traded), key=lambda each: each[0])

    def _end(self, model: Model, step: Array, way: Change) -> tuple[float, Model, list[View]]:
        tried = self.moved(model, step, way)
        there = [view(tried, each.record, each) for each in self.views]
        return _square(tried, there, self.training), tried, there

    def moved(self, model: Model, step: Array, way: Change = changed) -> Model:
        """``model`` with its parameters and coefficients moved; starts are found by every simulation anew."""
        first = self.first
        searched = self.training.searched
        plant = model.plant
        if searched:
            change = step[first : first + len(searched)]
            values = {
                **plant.values,
                **{name: bounded(plant, name, float(d), way) for name, d in zip(searched, change)},
            }
            plant = Plant.of(plant.circuit, values, plant.period_s)
        effects = list(model.effects)
        for unknown, change in zip(self.unknowns, step[first + len(searched) :]):
            effects[unknown.effect] = moved(effects[unknown.effect], unknown, float(change))
        return Model(plant, tuple(effects))

    def covariance(self) -> Array:
        """Of all unknowns, (c, c): that of white noise, and what the blocks of time disagree by besides.

        H^-1 + H^-1 (sum_b g_b g_b') H^-1, g_b being what block b pulls by (Huber 1967, by clusters): a circuit is
        never quite right, and not everywhere in the same way.
        """
        noise = self.training.noise
        rows = sum(float((~np.isnan(noise.white(each.residual_degC))).sum()) for each in self.views)
        left = sum(_whitened_square(each.residual_degC, noise) for each in self.views)
        variance = left / max(1.0, rows - len(self.columns[0]))
        inverse = _inverse(self.parts[0].sum(axis=0) / variance + self.held[0])
        pulls = np.concatenate([_pulls(each, noise, own) for each, own in zip(self.views, self.columns)]) / variance
        return np.asarray(inverse + inverse @ (pulls.T @ pulls) @ inverse)

    def with_covariance(self, model: Model) -> Model:
        """``model`` with the covariance of each effect's coefficients beside all that is fitted with them."""
        covariance = self.covariance()
        first = self.first + len(self.training.searched)
        effects = []
        for index, effect in enumerate(model.effects):
            count = len(effect.values)
            places = {
                count if each.kind is Kind.SHAPE else each.term: first + at
                for at, each in enumerate(self.unknowns)
                if each.effect == index and each.kind in (Kind.COEFFICIENT, Kind.SHAPE)
            }
            own = np.zeros((count + 1, count + 1))
            own[np.ix_(list(places), list(places))] = covariance[np.ix_(list(places.values()), list(places.values()))]
            effects.append(replace(effect, covariance=own))
        return replace(model, effects=tuple(effects))


def _inverse(matrix: Array) -> Array:
    """Inverse of a symmetric matrix whose rows differ in size; zero where it is singular."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    scaled = matrix / np.outer(size, size)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-10, hermitian=True) / np.outer(size, size))


def _normal(views: Sequence[View], noise: Noise, columns: Sequence[Array]) -> tuple[Array, Array]:
    count = len(columns[0])
    matrices, sides = np.zeros((FOLDS, count, count)), np.zeros((FOLDS, count))
    for each, mine in zip(views, columns):
        left = noise.white(each.residual_degC)
        known = ~np.isnan(left)
        white = noise.white(mine)
        block = blocks(each.record)
        # a row belongs to a fold only with all that it is whitened by
        inside = block[ORDER:] == block[:-ORDER]
        for fold in range(FOLDS):
            rows = known & inside & (block[ORDER:] % FOLDS == fold)
            part = white[:, rows]
            matrices[fold] += part @ part.T
            sides[fold] += part @ left[rows]
    return matrices, sides


def _pulls(each: View, noise: Noise, own: Array) -> Array:
    """By block of time, what its rows would move each unknown by, before the rest holds it, (b, c)."""
    left = np.nan_to_num(noise.white(each.residual_degC))
    block = blocks(each.record)[ORDER:]
    products = np.einsum("csk,sk->ck", noise.white(own), left)
    block = block * _CLUSTERS // (block[-1] + 1)
    edges = np.flatnonzero(np.diff(block, prepend=-1))
    return np.asarray(np.add.reduceat(products, edges, axis=1).T)
