"""Everything that a model leaves free is fitted together: starts, circuit parameters, the effects' coefficients.

One step solves the linear problem about the model as it stands and simulates again. By blocks of time, the same normal
equations less a block's own give what would have been fitted without it: that is how the gain on held-out data is
measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.extended import Effect, Model, view
from ambient_trainer.diagnosis.noise import ORDER, Noise
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.terms import HeatTerm, Term, beginning, ending
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

FOLDS = 5
_BLOCKS = 50
_STEP = 1e-3
_LONGEST = 0.7
_RIDGE, _HELD = 1e-9, 1e-6
_SETTLED = 1e-3
_JACKKNIFE = (2.776 / 1.96) ** 2
"""Student's t of four degrees of freedom over the normal's quantile."""


@dataclass(frozen=True)
class Teaching:
    """What a model is fitted to: records, the noise they are whitened by, and the circuit's parameters to search.

    ``searched`` is empty where known-good records have fixed the circuit.
    """

    records: tuple[Record, ...]
    noise: Noise
    searched: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fitted:
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
    length = max(4 * ORDER, record.samples // _BLOCKS)
    return np.arange(record.samples, dtype=np.intp) // length


def fitted(model: Model, teaching: Teaching, rounds: int) -> Fitted:
    """``model`` with all that is free in it fitted in so many steps, each taken only as far as it helps."""
    views = _views(model, teaching)
    square = _square(views, teaching.noise)
    damping = _RIDGE
    for _ in range(rounds if np.isfinite(square) else 0):
        system = _System.of(model, views, teaching)
        before = square
        while damping <= 1.0:
            tried = system.moved(model, system.solution(model.plant, damping))
            there = _views(tried, teaching)
            after = _square(there, teaching.noise)
            if after < square:
                model, views, square = tried, there, after
                break
            damping *= 30.0
        if square > (1.0 - _SETTLED) * before:
            break
        damping = max(_RIDGE, damping / 30.0)
    if not np.isfinite(square):
        return Fitted(model, tuple(views), tuple(each.residual_degC for each in views), np.inf)
    system = _System.of(model, views, teaching)
    held_out = system.held_out()
    model = system.with_covariance(model)
    errors = tuple(_whitened_square(each, teaching.noise) for each in held_out)
    return Fitted(model, tuple(views), held_out, float(sum(errors)))


def nuisances(current: Fitted, searched: Sequence[str]) -> list[list[Array]]:
    """Per view what the searched parameters and the effects that are there already do to the sensors, (s, N) each."""
    return [
        [*_slopes(current.model, searched, each), *_effect_columns(current.model, each).values()]
        for each in current.views
    ]


def _views(model: Model, teaching: Teaching) -> list[View]:
    return [view(model, record) for record in teaching.records]


def _square(views: Sequence[View], noise: Noise) -> float:
    if not all(np.isfinite(each.simulated_degC).all() for each in views):
        return np.inf
    return sum(_whitened_square(each.residual_degC, noise) for each in views)


def _whitened_square(residual: Array, noise: Noise) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(np.nansum(noise.white(residual) ** 2))
    return square if np.isfinite(square) else np.inf


@dataclass(frozen=True)
class _System:
    """Columns per view (c, s, N): all views' starts, the searched parameters, the effects' free coefficients."""

    views: Sequence[View]
    teaching: Teaching
    columns: list[Array]
    places: tuple[tuple[int, int], ...]
    """Per effect's free coefficient: which effect, which of its coefficients."""
    parts: tuple[Array, Array]
    """Per fold the normal matrix (f, c, c) and its right-hand side (f, c)."""

    @staticmethod
    def of(model: Model, views: Sequence[View], teaching: Teaching) -> _System:
        places = tuple(
            (index, term)
            for index, effect in enumerate(model.effects)
            for term, fixed in enumerate(effect.candidate.fixed)
            if fixed is None and not effect.known
        )
        columns = []
        for own, each in enumerate(views):
            starts = [
                each_start for index, there in enumerate(views) for each_start in _own(there.starts, each, index == own)
            ]
            slopes = _slopes(model, teaching.searched, each)
            effects = _effect_columns(model, each)
            columns.append(np.array([*starts, *slopes, *(effects[place] for place in places)]))
        return _System(views, teaching, columns, places, _normal(views, teaching.noise, columns))

    @property
    def _count(self) -> int:
        return len(self.columns[0])

    def solution(self, plant: Plant, damping: float) -> Array:
        """The step to the least squares of all rows, held back by ``damping`` (Marquardt 1963)."""
        matrix, side = self.parts[0].sum(axis=0), self.parts[1].sum(axis=0)
        free = np.ones(len(side), dtype=bool)
        first = self._count - len(self.places) - len(self.teaching.searched)
        step = np.zeros(len(side))
        for _ in range(len(self.teaching.searched) + 1):
            step = np.zeros(len(side))
            step[free] = _solved(matrix[np.ix_(free, free)], side[free], damping)
            stopped = [
                first + index
                for index, name in enumerate(self.teaching.searched)
                if step[first + index]
                and np.isclose(bounded(plant, name, float(step[first + index])), plant.values[name], rtol=1e-9)
            ]
            if not stopped:
                break
            # what a bound holds must not be counted on
            free[stopped] = False
        return step

    def held_out(self) -> tuple[Array, ...]:
        """Per view the residual (s, N) with coefficients that have not seen the sample's block."""
        # where a run began belongs to the run: no other block could tell it
        starts = sum(len(each.starts) for each in self.views)
        matrices, sides = self.parts[0][:, starts:, starts:], self.parts[1][:, starts:]
        whole = _solved(matrices.sum(axis=0), sides.sum(axis=0), _HELD)
        # what is left to gain on all rows is no gain of a fold
        steps = [
            _solved(matrices.sum(axis=0) - matrices[fold], sides.sum(axis=0) - sides[fold], _HELD) - whole
            for fold in range(FOLDS)
        ]
        result = []
        for each, columns in zip(self.views, self.columns):
            fold = blocks(each.record) % FOLDS
            error = each.residual_degC.copy()
            for index, step in enumerate(steps):
                mine = fold == index
                error[:, mine] -= np.einsum("c,csk->sk", step, columns[starts:, :, mine])
            result.append(error)
        return tuple(result)

    def _folds(self) -> Iterator[tuple[Array, Array, Array]]:
        side = self.parts[1].sum(axis=0)
        for own, part in zip(*self.parts):
            yield own, part, side

    def moved(self, model: Model, step: Array) -> Model:
        """``model`` with its parameters and coefficients moved; starts are found by every simulation anew."""
        first = self._count - len(self.places)
        searched = self.teaching.searched
        plant = model.plant
        if searched:
            change = step[first - len(searched) : first]
            values = {
                **plant.values,
                **{name: bounded(plant, name, float(d)) for name, d in zip(searched, change)},
            }
            plant = Plant.of(plant.circuit, values, plant.period_s)
        effects = [effect.values.copy() for effect in model.effects]
        for (index, term), change in zip(self.places, step[first:]):
            effects[index][term] += change
        moved = tuple(replace(effect, values=values) for effect, values in zip(model.effects, effects))
        return Model(plant, moved)

    def with_covariance(self, model: Model) -> Model:
        """``model`` with the covariance of each effect's coefficients beside all that is fitted with them.

        To that of white noise comes what leaving out a fifth of the blocks changes (jackknife): a circuit is never
        quite right, and not everywhere in the same way.
        """
        matrix = self.parts[0].sum(axis=0)
        noise = self.teaching.noise
        rows = sum(float((~np.isnan(noise.white(each.residual_degC))).sum()) for each in self.views)
        variance = _square(self.views, noise) / max(1.0, rows - self._count)
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
        inverse = np.linalg.pinv(matrix / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
        first = self._count - len(self.places)
        folds = np.array([_solved(matrix - own, side - part, _HELD) for own, part, side in self._folds()])
        spread = _JACKKNIFE * (FOLDS - 1) * np.cov(folds.T, bias=True)
        effects = []
        for index, effect in enumerate(model.effects):
            mine = [first + at for at, (owner, _) in enumerate(self.places) if owner == index]
            terms = [term for owner, term in self.places if owner == index]
            covariance = effect.covariance.copy()
            covariance[np.ix_(terms, terms)] = (inverse * variance + spread)[np.ix_(mine, mine)]
            effects.append(replace(effect, covariance=covariance))
        return replace(model, effects=tuple(effects))


def _solved(matrix: Array, side: Array, damping: float) -> Array:
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    scaled = matrix / np.outer(size, size) + damping * np.eye(len(size))
    return np.asarray(np.linalg.solve(scaled, side / size) / size)


def _own(starts: Array, each: View, mine: bool) -> Array:
    return each.starts if mine else np.zeros((len(starts), *each.starts.shape[1:]))


def _slopes(model: Model, searched: Sequence[str], here: View) -> list[Array]:
    """What the logarithm of each searched parameter does to the sensors, (s, N), starts and the effects' heat held."""
    if not searched:
        return []
    plant = model.plant
    heat_W = _heat_W(model, here)
    base = _simulated(plant, here, heat_W)
    result = []
    for name in searched:
        values = {**plant.values, name: changed(plant, name, _STEP)}
        moved = Plant.of(plant.circuit, values, plant.period_s)
        result.append((_simulated(moved, here, heat_W) - base) / _STEP)
    return result


def _heat_W(model: Model, here: View) -> Array:
    """What all effects give to each node, (n, N)."""
    heat = np.zeros_like(here.nodes_degC)
    for effect in model.effects:
        window, begins = effect.window(here.record), effect.begins(here.record)
        for value, term in zip(effect.values, effect.candidate.terms(here)):
            if isinstance(term, HeatTerm):
                law = term.value(here.nodes_degC, here.ambient_degC, here.plant.period_s, begins)
                heat += value * window * term.weight * law
    return heat


def changed(plant: Plant, name: str, step: float) -> float:
    """A parameter moved by ``step``: resistances and capacitances in their logarithm, a share by as much of itself."""
    value = plant.values[name]
    shares = {source.share for source in plant.circuit.sources}
    # a parameter that the data do not tell asks for steps beyond all measure
    step = min(max(step, -_LONGEST), _LONGEST)
    return value + step * max(abs(value), 0.1) if name in shares else value * float(np.exp(step))


def bounded(plant: Plant, name: str, step: float) -> float:
    """As :func:`changed`, within the parameter's bounds."""
    limits = next(each for each in plant.circuit.parameters if each.name == name)
    return float(np.clip(changed(plant, name, step), limits.low, limits.high))


def _simulated(plant: Plant, here: View, heat_W: Array) -> Array:
    settled = plant.forced(here.record.inputs) + plant.V @ plant.modal(plant.W @ (heat_W / plant.capacitance[:, None]))
    # the start that the record was found to have, in the moved circuit
    decays = plant.decays(here.record.samples)
    return np.asarray((settled + np.einsum("i,ink->nk", here.start, decays))[plant.reads])


def _effect_columns(model: Model, each: View) -> dict[tuple[int, int], Array]:
    result = {}
    for index, effect in enumerate(model.effects):
        for term, fixed in enumerate(effect.candidate.fixed):
            if fixed is None and not effect.known:
                result[index, term] = _acting(each, effect.candidate.terms(each)[term], effect)
    return result


def _acting(each: View, term: Term, effect: Effect) -> Array:
    """What a term adds to each sensor while its effect lasts, (s, N)."""
    added = beginning(each, term, [effect.onset_s])[0]
    return added if effect.end_s is None else added - ending(each, term, [effect.end_s])[0]


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
