"""Levenberg-Marquardt in a box, written for residuals that cost much and Jacobians that may lack rank.

Each step solves min |J p + r|^2 + damping |D p|^2, D being the largest column lengths so far (More 1978), over the
unknowns that no bound holds; the damping follows Nielsen 1999 (report IMM-REP-1999-05). Library methods need two to
three times the evaluations here (bounded trust regions scale every step by its distance to the box), stop at missing
rank, or know no bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array

_LONGEST_STEP = 2.0
_SHORT = 1e-5
_SMALLEST_GAIN = 1e-10
_SMALLEST_STEP = 1e-9
_STUCK = 1e6
_CRAWL = 1e-4


class Evaluation(NamedTuple):
    """The residual (r,) and its Jacobian (r, P) at a point."""

    residual: Array
    jacobian: Array


class End(NamedTuple):
    """Where a descent ended, and whether it ended because nothing more was to be gained."""

    point: Array
    settled: bool


def descend(
    evaluate: Callable[[Array], Evaluation],
    start: Array,
    low: Array,
    high: Array,
    most: int,
    patience: int | None = None,
    over: Callable[[], bool] = lambda: False,
) -> End:
    """Minimise |residual|^2 over low <= point <= high from ``start`` with at most ``most`` evaluations.

    It ends, unsettled, after the evaluation that makes ``over`` true, and gives up when ``patience`` evaluations have
    not brought the square down by 1e-4 of itself: it then creeps along a valley without a floor. None is never.
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
                return End(point, settled=False)
            milestone = (evaluations, square)
        gradient = here.jacobian.T @ here.residual
        loose = ~(((point <= low) & (gradient > 0)) | ((point >= high) & (gradient < 0)))
        lengths = np.maximum(lengths, np.linalg.norm(here.jacobian, axis=0))
        wanted = _step(here, lengths, loose, damping)
        if np.abs(wanted).max(initial=0.0) < _SMALLEST_STEP or _gain(here, wanted) <= _SMALLEST_GAIN * square:
            return End(point, settled=damping < _STUCK)
        moved = np.clip(point + np.clip(wanted, -_LONGEST_STEP, _LONGEST_STEP), low, high)
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
    return End(point, settled=False)


def _gain(here: Evaluation, step: Array) -> float:
    """By how much the linear model's sum of squares falls along ``step``."""
    change = here.jacobian @ step
    return -float(change @ (2 * here.residual + change))


def _step(here: Evaluation, lengths: Array, loose: NDArray[np.bool_], damping: float) -> Array:
    """The damped step.

    An unknown whose column is short beside the longest is damped as if it were not: what rounding leaves of a column
    that should be zero must not throw its unknown across the box.
    """
    step = np.zeros(len(loose))
    D = np.sqrt(damping) * np.maximum(lengths[loose], _SHORT * lengths.max(initial=1e-300))
    system = np.concatenate([here.jacobian[:, loose], np.diag(D)])
    step[loose] = np.linalg.lstsq(system, -np.concatenate([here.residual, np.zeros(len(D))]), rcond=None)[0]
    return step
