"""The search from several starts, on what variable projection leaves of the problem.

It can be stopped at any time and then returns the best so far, marked so.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.estimation.marquardt import Evaluation, descend
from ambient_trainer.estimation.separable import project
from ambient_trainer.estimation.structure import Structure, linearise

Array = NDArray[np.float64]

_BEFORE_REGROUPING = 25
_MOST_EVALUATIONS = 175
_PATIENCE = 12
_OFFSET = 0.1
_ROUNDING = 1e-8


@dataclass(frozen=True)
class Solution:
    """Where a search ended: theta (P,), beta (p,), the sum of squared residuals in degC^2."""

    theta: Array
    beta: Array
    sum_of_squares: float
    objective: float
    """The sum of squares and what leaving believable values costs."""
    converged: bool
    evaluations: int


@dataclass(frozen=True)
class SearchResult:
    """The best of all starts, every start's end, and whether the user stopped it."""

    best: Solution
    starts: tuple[Solution, ...]
    evaluations: int
    """Of all starts, and of what followed from the best."""
    stopped: bool


Progress = Callable[[int, int, float], None]
"""Called after each evaluation with the start's number, the evaluation's, and the best sum of squares so far."""


def search_whole(structure: Structure, starts: int, seed: int, progress: Progress | None = None) -> SearchResult:
    """As :func:`search`, for those who have no use for a part of it: Ctrl-C is a KeyboardInterrupt."""
    result = search(structure, starts, seed, progress)
    if result.stopped:
        raise KeyboardInterrupt
    return result


def search(structure: Structure, starts: int, seed: int, progress: Progress | None = None) -> SearchResult:
    """Search from the initial values and ``starts`` - 1 random ones; Ctrl-C returns the best so far."""
    random = np.random.default_rng(seed)
    ends: list[Solution] = []
    best: Solution | None = None
    for number in range(starts):
        theta = structure.search.initial if number == 0 else structure.random_start(random)
        run = _Run(structure, number, best, progress)
        try:
            ends.append(run.descend(theta))
            best = run.best
        except KeyboardInterrupt:
            if run.best is None:
                raise
            return SearchResult(run.best, (*ends, run.best), _spent(ends) + run.evaluations, stopped=True)
    if best is None:
        raise ValueError("a search needs at least one start")
    if best.converged:
        return SearchResult(best, tuple(ends), _spent(ends), stopped=False)
    run = _Run(structure, starts - 1, best, progress)
    try:
        best, stopped = run.finish(best.theta), False
    except KeyboardInterrupt:
        best, stopped = run.best or best, True
    return SearchResult(best, tuple(ends), _spent(ends) + run.evaluations, stopped)


def _spent(ends: list[Solution]) -> int:
    return sum(each.evaluations for each in ends)


class _Run:
    """One descent, which remembers the best point any descent has seen."""

    def __init__(self, structure: Structure, number: int, best: Solution | None, progress: Progress | None) -> None:
        self.structure = structure
        self.number = number
        self.best = best
        self.progress = progress
        self.evaluations = 0
        self.weight = math.sqrt(sum(float(np.nansum(each.outputs**2)) for each in structure.segments))
        self.samples = sum(int(np.count_nonzero(~np.isnan(each.outputs))) for each in structure.segments)
        self._at: tuple[bytes, Evaluation] | None = None
        self._end: Solution

    def finish(self, theta: Array) -> Solution:
        """Go on from the best end of all starts, patiently: what one descent may spend is spent once."""
        bounds = self.structure.search
        found = descend(self._evaluate, theta, bounds.low, bounds.high, _MOST_EVALUATIONS)
        self._closed(found.point, converged=found.settled and self._stationary(found.point))
        assert self.best is not None
        return self.best

    def descend(self, theta: Array) -> Solution:
        bounds = self.structure.search
        if not len(theta):
            return self._closed(theta, converged=True)
        found = descend(self._evaluate, theta, bounds.low, bounds.high, _BEFORE_REGROUPING, _PATIENCE)
        better = self.structure.regrouped(found.point)
        if not found.settled or not np.array_equal(better, found.point):
            found = descend(self._evaluate, better, bounds.low, bounds.high, _MOST_EVALUATIONS, _PATIENCE)
        return self._closed(found.point, converged=found.settled and self._stationary(found.point))

    def _evaluate(self, theta: Array) -> Evaluation:
        """The residual, and below it by how much theta leaves what is believable, as heavy as the data."""
        key = theta.tobytes()
        if self._at is None or self._at[0] != key:
            found = project(linearise(self.structure, theta), self.structure.linear)
            excess, slope = self.structure.excess(theta)
            residual = np.concatenate([found.residual, self.weight * excess])
            self._at = (key, Evaluation(residual, np.concatenate([found.jacobian, self.weight * slope])))
            self.evaluations += 1
            square = float(found.residual @ found.residual)
            self._end = Solution(theta.copy(), found.beta, square, float(residual @ residual), False, self.evaluations)
            if self.best is None or self._end.objective < self.best.objective:
                self.best = self._end
            if self.progress is not None:
                self.progress(self.number, self.evaluations, self.best.sum_of_squares)
        return self._at[1]

    def _closed(self, theta: Array, converged: bool) -> Solution:
        self._evaluate(theta)
        end = replace(self._end, converged=converged, evaluations=self.evaluations)
        if self.best is None or end.objective <= self.best.objective:
            self.best = end
        return end

    def _stationary(self, theta: Array) -> bool:
        """Whether what is left to move is a tenth of a standard error (relative offset: Bates and Watts 1981).

        |U' rho| / sqrt(P) <= 0.1 |rho| / sqrt(N - P), U spanning the columns of J away from the bounds that stand out
        of rounding.
        """
        here = self._evaluate(theta)
        bounds = self.structure.search
        wide = bounds.high - bounds.low
        room = np.where(np.isfinite(wide), 1e-6 * wide, 0.0)
        J = here.jacobian[:, (theta > bounds.low + room) & (theta < bounds.high - room)]
        lengths = np.linalg.norm(J, axis=0)
        J = J[:, lengths > _ROUNDING * lengths.max(initial=0.0)]
        if not J.shape[1]:
            return True
        U, singular, _ = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
        U = U[:, singular > _ROUNDING * singular[0]]
        spare = max(self.samples - U.shape[1], 1)
        left = np.linalg.norm(U.T @ here.residual) / math.sqrt(U.shape[1])
        return bool(left <= _OFFSET * np.linalg.norm(here.residual) / math.sqrt(spare))
