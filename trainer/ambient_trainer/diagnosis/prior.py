"""The prior of a model's parameters: a quadratic about values, from the circuit's file or from known-good records.

By the file, a parameter is about its initial value, between its bounds. Known-good records give values and their
information: a parameter that they hardly determine (the loss of a node that they never heated) is left to the diagnosed
records, one that they determine well does not move to explain a change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ambient_trainer.diagnosis.circuit_parameters import moved_by, moved_to
from ambient_trainer.diagnosis.model import Model
from ambient_trainer.diagnosis.plant import Plant

Array = NDArray[np.float64]

_COVERED = 0.95
_SLACK = 1.5
_HARDEST, _RIDGE = 1e9, 1e-9


@dataclass(frozen=True)
class Prior:
    """The information (u, u) about the ``searched`` parameters and the known effects' free coefficients of ``about``.

    Their way from there, squared by it, may not go beyond ``limit``.
    """

    about: Model
    searched: tuple[str, ...]
    information: Array
    limit: float = np.inf

    @staticmethod
    def by_design(model: Model, searched: tuple[str, ...]) -> Prior:
        """What the circuit's file says: an initial value, and bounds that are four standard deviations apart."""
        circuit, plant = model.plant.circuit, model.plant
        initial = {each.name: each.initial for each in circuit.parameters}
        ends = {each.name: (each.low, each.high) for each in circuit.parameters}
        about = Plant.of(circuit, {**plant.values, **{name: initial[name] for name in searched}}, plant.period_s)
        deviations = [
            (moved_to(about, name, ends[name][1]) - moved_to(about, name, ends[name][0])) / 4.0 for name in searched
        ]
        free = sum(each is None for effect in model.effects for each in effect.candidate.fixed)
        information = np.diag([*(1.0 / each**2 for each in deviations), *[0.0] * free])
        return Prior(Model(about, model.effects), searched, information)

    @staticmethod
    def trained(model: Model, searched: tuple[str, ...], information: Array) -> Prior:
        """What known-good records trained."""
        return Prior(model, searched, information, float(chi2.ppf(_COVERED, max(1, len(information)))))

    def normal(self, model: Model, factor: float) -> tuple[Array, Array]:
        """The normal matrix (u, u) of steps from ``model``, and their right-hand side (u,), ``factor`` times."""
        way, scale = self._way(model)
        return factor * self.information * np.outer(scale, scale), -factor * scale * (self.information @ way)

    def factor(self, model: Model, matrix: Array, side: Array, first: int) -> float:
        """By how much harder than as it is known it must be held not to go beyond the limit.

        By rows of which ``matrix`` (c, c) and ``side`` (c,) are the normal equations; what this is about is there from
        the index ``first`` on.
        """
        way, scale = self._way(model)
        known, pull = self.normal(model, 1.0)
        mine = slice(first, first + len(way))
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
        factor = 1.0
        while factor < _HARDEST:
            held, towards = matrix.copy(), side.copy()
            held[mine, mine] += factor * known
            towards[mine] += factor * pull
            step = np.linalg.solve(held / np.outer(size, size) + _RIDGE * np.eye(len(size)), towards / size) / size
            there = way + scale * step[mine]
            if there @ self.information @ there <= self.limit:
                break
            factor *= 2.0
        return factor

    def rows(self, model: Model, factor: float) -> tuple[Array, Array]:
        """As many rows as unknowns, (u, u), of unit variance, that say the same, and what each is off by, (u,)."""
        way, scale = self._way(model)
        values, vectors = np.linalg.eigh(factor * self.information)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        return root * scale, -root @ way

    def square(self, model: Model) -> float:
        """How far ``model`` is from there, in the units of whitened squares; endless where that is too far."""
        way, _ = self._way(model)
        square = float(way @ self.information @ way)
        return square if square <= _SLACK * self.limit else np.inf

    def _way(self, model: Model) -> tuple[Array, Array]:
        """How far each unknown has moved, and what a step from ``model`` adds to that, (u,)."""
        ways = [moved_by(self.about.plant, model.plant, name) for name in self.searched]
        for before, now in zip(self.about.effects, model.effects):
            ways.extend(
                (float(now.values[term] - before.values[term]), 1.0)
                for term, fixed in enumerate(before.candidate.fixed)
                if fixed is None
            )
        return np.array([way for way, _ in ways]), np.array([scale for _, scale in ways])
