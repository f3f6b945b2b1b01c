"""Multistart search of the nonlinear parameters by variable projection.

A budget that is spent or cancelled ends it between two evaluations, never an exception raised on itself; the result is
then the best so far, marked as stopped. Who cancels holds the budget; who searches asks it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.structure import LONGEST_STEP, Projection, Structure, project

_SHORT = 1e-5
_SMALLEST_GAIN = 1e-10
_SMALLEST_STEP = 1e-9
_STUCK = 1e6
_CRAWL = 1e-4


class Cancelled(Exception):
    """Raised where cancelled work has no result that is of use: nothing was searched to the end."""


@dataclass
class Budget:
    """How much a search may spend: so many ``evaluations`` over all starts, or without a limit beyond each descent's.

    Whoever holds it may cancel what searches with it, after the evaluation under way.
    """

    evaluations: int | None = None
    cancelled: bool = False

    def cancel(self) -> None:
        """Ask to stop; safe in a signal handler."""
        self.cancelled = True

    def check(self) -> None:
        """Raise :class:`Cancelled` where this was cancelled: for work whose part is of no use."""
        if self.cancelled:
            raise Cancelled

    def spent(self, evaluations: int) -> bool:
        """Whether to stop after so many evaluations."""
        return self.cancelled or (self.evaluations is not None and evaluations >= self.evaluations)


def descend(
    evaluate: Callable[[Array], Projection],
    start: Array,
    low: Array,
    high: Array,
    most: int,
    patience: int | None = None,
    over: Callable[[], bool] = lambda: False,
    longest: Array | float = LONGEST_STEP,
) -> tuple[Array, bool]:
    """Levenberg-Marquardt in a box: |residual|^2 over low <= point <= high with at most ``most`` evaluations.

    Gives the point where it ended, and whether it settled: nothing more was to be gained.

    Each step solves min |J p + r|^2 + damping |D p|^2, D being the largest column lengths so far (More 1978), over the
    unknowns that no bound holds; the damping follows Nielsen 1999 (report IMM-REP-1999-05). Library methods need two to
    three times the evaluations here, stop at missing rank, or know no bounds. It ends, unsettled, after the evaluation
    that makes ``over`` true, and when ``patience`` evaluations have not brought the square down by 1e-4 of itself.
    """
    point = np.clip(start, low, high)
    here = evaluate(point)
    lengths = np.linalg.norm(here.jacobian, axis=0)
    damping, growth = 1e-3, 2.0
    evaluations = 1
    milestone = (1, float(here.residual @ here.residual))
    while evaluations < most and not over():
        square = float(here.residual @ here.residual)
        if patience is not None and evaluations >= milestone[0] + patience:
            if square > (1 - _CRAWL) * milestone[1]:
                return point, False
            milestone = (evaluations, square)
        gradient = here.jacobian.T @ here.residual
        loose = ~(((point <= low) & (gradient > 0)) | ((point >= high) & (gradient < 0)))
        lengths = np.maximum(lengths, np.linalg.norm(here.jacobian, axis=0))
        wanted = _step(here, lengths, loose, damping)
        if np.abs(wanted).max(initial=0.0) < _SMALLEST_STEP or _gain(here, wanted) <= _SMALLEST_GAIN * square:
            return point, damping < _STUCK
        moved = np.clip(point + np.clip(wanted, -longest, longest), low, high)
        promised = _gain(here, moved - point)
        ratio = -1.0
        if promised > 0:
            there = evaluate(moved)
            evaluations += 1
            ratio = (square - float(there.residual @ there.residual)) / promised
        if ratio > 1e-4:
            point, here = moved, there
            damping, growth = max(damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3), 1e-12), 2.0
        else:
            damping, growth = damping * growth, growth * 2
    return point, False


def _gain(here: Projection, step: Array) -> float:
    """By how much the linear model's sum of squares falls along ``step``."""
    change = here.jacobian @ step
    return -float(change @ (2 * here.residual + change))


def _step(here: Projection, lengths: Array, loose: NDArray[np.bool_], damping: float) -> Array:
    """The damped step.

    An unknown whose column is short beside the longest is damped as if it were not: what rounding leaves of a column
    that should be zero must not throw its unknown across the box.
    """
    step = np.zeros(len(loose))
    D = np.sqrt(damping) * np.maximum(lengths[loose], _SHORT * lengths.max(initial=1e-300))
    system = np.concatenate([here.jacobian[:, loose], np.diag(D)])
    step[loose] = np.linalg.lstsq(system, -np.concatenate([here.residual, np.zeros(len(D))]), rcond=None)[0]
    return step


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
    """The sum of squares and the penalty."""
    converged: bool
    evaluations: int


@dataclass(frozen=True)
class MultistartResult:
    """The best of all starts, every start's end, and whether the budget stopped the search."""

    best: Solution
    starts: tuple[Solution, ...]
    evaluations: int
    """Of all starts, and of what followed from the best."""
    stopped: bool


Progress = Callable[[int, int, float], None]
"""Called after each evaluation with the start's number, the evaluation's, and the best sum of squares so far."""


def search(
    structure: Structure,
    starts: int,
    seed: int,
    progress: Progress | None = None,
    budget: Budget | None = None,
    first: int = 0,
) -> MultistartResult:
    """Best of several descents, those from number ``first`` on: 0 from the initial values, others from random places.

    Where the ``budget`` ends it, the result is the best so far, marked as stopped; at least one evaluation is made.
    """
    if starts < 1:
        raise ValueError("a search needs at least one start")
    random = np.random.default_rng(seed)
    run = _Run(structure, progress, budget or Budget())
    ends = []
    places = [structure.search.initial, *(structure.random_start(random) for _ in range(first + starts - 1))]
    for number, theta in enumerate(places[first:]):
        ends.append(run.descend(number, theta))
        if run.over():
            return MultistartResult(run.best, tuple(ends), run.spent, stopped=True)
    if not run.best.converged:
        run.finish(starts - 1)
    return MultistartResult(run.best, tuple(ends), run.spent, run.over())


class _Run:
    """The descents of a search, and the best point that any of them has seen."""

    _end: Solution

    def __init__(self, structure: Structure, progress: Progress | None, budget: Budget) -> None:
        self.structure, self.progress, self.budget = structure, progress, budget
        self.spent = 0
        """Evaluations of all descents."""
        self.best = Solution(structure.search.initial, np.zeros(0), math.inf, math.inf, False, 0)
        self.weight = math.sqrt(sum(float(np.nansum(each.outputs**2)) for each in structure.segments))
        self.samples = sum(int(np.count_nonzero(~np.isnan(each.outputs))) for each in structure.segments)

    def over(self) -> bool:
        return self.budget.spent(self.spent)

    def descend(self, number: int, theta: Array) -> Solution:
        """The end of start ``number``, from ``theta``; the best so far where the budget ends it."""
        self._begin(number)
        if not len(theta):
            return self._closed(theta, settled=True)
        end, settled = self._descended(theta, _BEFORE_REGROUPING, _PATIENCE)
        better = self.structure.regrouped(end)
        if not self.over() and (not settled or not np.array_equal(better, end)):
            end, settled = self._descended(better, _MOST_EVALUATIONS, _PATIENCE)
        return self._closed(end, settled)

    def finish(self, number: int) -> None:
        """Go on from the best end of all starts, patiently: what one descent may spend is spent once."""
        self._begin(number)
        self._closed(*self._descended(self.best.theta, _MOST_EVALUATIONS, None))

    def _begin(self, number: int) -> None:
        self._number, self._evaluations = number, 0
        self._at: tuple[bytes, Projection] | None = None

    def _descended(self, theta: Array, most: int, patience: int | None) -> tuple[Array, bool]:
        bounds = self.structure.search
        return descend(self._evaluate, theta, bounds.low, bounds.high, most, patience, self.over, bounds.longest_step)

    def _evaluate(self, theta: Array) -> Projection:
        """The residual, and below it by how much theta leaves its bounds of plausibility, weighed like the data."""
        key = theta.tobytes()
        if self._at is None or self._at[0] != key:
            found = project(self.structure, theta)
            penalty, slope = self.structure.penalty(theta)
            residual = np.concatenate([found.residual, self.weight * penalty])
            self._at = (key, Projection(residual, np.concatenate([found.jacobian, self.weight * slope])))
            self._evaluations += 1
            self.spent += 1
            square = float(found.residual @ found.residual)
            self._end = Solution(theta.copy(), found.beta, square, float(residual @ residual), False, self._evaluations)
            if self._end.objective < self.best.objective:
                self.best = self._end
            if self.progress is not None:
                self.progress(self._number, self._evaluations, self.best.sum_of_squares)
        return self._at[1]

    def _closed(self, end: Array, settled: bool) -> Solution:
        if self.over():
            return self.best
        self._evaluate(end)
        converged = settled and self._stationary(end)
        solution = replace(self._end, converged=converged, evaluations=self._evaluations)
        if solution.objective <= self.best.objective:
            self.best = solution
        return solution

    def _stationary(self, theta: Array) -> bool:
        """Whether what is left to move is a tenth of a standard error (relative offset: Bates and Watts 1981).

        |U' rho| / sqrt(P) <= 0.1 |rho| / sqrt(N - P), U spanning the columns of J away from the bounds that stand out
        of rounding.
        """
        here = self._evaluate(theta)
        J = here.jacobian[:, ~self.structure.search.at_bound(theta)]
        lengths = np.linalg.norm(J, axis=0)
        J = J[:, lengths > _ROUNDING * lengths.max(initial=0.0)]
        if not J.shape[1]:
            return True
        U, singular, _ = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
        U = U[:, singular > _ROUNDING * singular[0]]
        spare = max(self.samples - U.shape[1], 1)
        left = np.linalg.norm(U.T @ here.residual) / math.sqrt(U.shape[1])
        return bool(left <= _OFFSET * np.linalg.norm(here.residual) / math.sqrt(spare))
