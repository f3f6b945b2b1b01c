"""The constrained free filter, and its order and assumed noise and offset, selected by the error over held-out blocks.

The blocks are of the training data. Selected is the lowest order, then the most noise, then the largest offset whose
error is not significantly above the best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.error_variance import Moment
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimation.validation import held_out
from ambient_trainer.estimation.weighted_filter import Run, impulses, level, offsets, weighted_filter
from ambient_trainer.estimators.base import Effort


def constrained(order: int, logged: Sequence[Segment], noise_degC: float, offset_degC: float = 0.0) -> FreeFilter:
    """The free filter of order N over segments, as if each sensor had more white noise and a larger offset than logged.

    Both are standard deviations. All sensors one degree up is the estimate one degree up.
    """
    period_s, inputs = logged[0].period_s, logged[0].inputs.shape[0]
    known = np.concatenate([each.outputs[0] for each in logged])
    known = known[~np.isnan(known)]
    root = float(np.sqrt(len(known)))
    longest = max(each.inputs.shape[1] for each in logged)
    runs = [Run(each, 1.0, True) for each in logged]
    runs += level(period_s, inputs, float(np.linalg.norm(known)))
    runs += impulses(period_s, inputs, noise_degC * root, longest)
    return weighted_filter(order, [*runs, *(offsets(period_s, inputs, offset_degC * root) if offset_degC else ())])


ORDERS = (1, 2, 3, 4)
BLOCKS = 5
_NOISES_DEGC = (0.003, 0.01, 0.03, 0.1)
_OFFSETS_DEGC = (0.0, 0.1, 0.3, 1.0)
"""Up to what uncalibrated thermistors and thermocouples are off by."""
_FIRST_NOISE_DEGC = 0.01
_AS_GOOD = 1.02
"""Of mean squares: 1 % of the error."""
_FIRST_STARTS = 2
"""Starts of the search on the whole training data, from whose end those without a block start."""


class Choice(NamedTuple):
    """An order, a noise and an offset, and the mean square of each block, of a filter that did not see it."""

    order: int
    noise_degC: float
    offset_degC: float
    squares_degC2: tuple[float, ...]

    def as_json(self) -> dict[str, float]:
        """For the provenance."""
        return {**dict(zip(self._fields[:3], self[:3])), "rmse_degC": self.rmse_degC}

    @property
    def rmse_degC(self) -> float:
        """Root of the mean square over all blocks."""
        return float(np.sqrt(np.mean(self.squares_degC2)))


def selected(tried: Sequence[Choice]) -> Choice:
    """The lowest order, and of it the most noise, and of that the largest offset, not significantly above the best.

    By a hundredth of the error, or by the standard error of the difference in mean square over the blocks.
    """
    best = np.array(min(tried, key=lambda each: each.rmse_degC).squares_degC2)

    def good(each: Choice) -> bool:
        above = np.array(each.squares_degC2) - best
        error = float(above.std(ddof=1)) / np.sqrt(len(above))
        return bool(above.mean() <= max((_AS_GOOD - 1) * best.mean(), error))

    return min(filter(good, tried), key=lambda each: (each.order, -each.noise_degC, -each.offset_degC))


class Selection:
    """The selection, as far as it has come."""

    def __init__(self, segments: Sequence[Segment], effort: Effort, progress: Progress | None) -> None:
        self.segments = segments
        self.effort = effort
        self.progress = progress
        self.tried: list[Choice] = []
        self.unseen: dict[Choice, list[Moment]] = {}
        """Per choice the estimates over blocks that were left out."""
        self._whole: dict[int, SearchResult] = {}

    def run(self) -> Choice | None:
        """Try every order, with that selected every noise, and with that every offset; None where cancelled."""
        grids: tuple[Callable[[Choice], list[tuple[int, float, float]]], ...] = (
            lambda best: [(best.order, each, 0.0) for each in _NOISES_DEGC if each != best.noise_degC],
            lambda best: [(best.order, best.noise_degC, each) for each in _OFFSETS_DEGC[1:]],
        )
        if not all(self._try(order, _FIRST_NOISE_DEGC, 0.0) for order in ORDERS):
            return None
        for grid in grids:
            if not all(self._try(*each) for each in grid(selected(self.tried))):
                return None
        return selected(self.tried)

    def best_so_far(self) -> tuple[int, SearchResult]:
        """The order to take where :meth:`run` was cancelled, and its search."""
        order = selected(self.tried).order if self.tried else min(self._whole)
        return order, replace(self._whole[order], stopped=True)

    def _try(self, order: int, noise_degC: float, offset_degC: float) -> bool:
        """Whether these were scored before the search was cancelled."""
        if order not in self._whole:
            structure = constrained(order, self.segments, noise_degC)
            starts = min(_FIRST_STARTS, self.effort.starts)
            self._whole[order] = search(structure, starts, self.effort.seed, self.progress, self.effort.budget)
        if self._whole[order].stopped:
            return False

        def without(kept: Sequence[Segment]) -> FreeFilter:
            return constrained(order, kept, noise_degC, offset_degC)

        start, budget = self._whole[order].best.theta, self.effort.budget
        blocks = held_out(without, self.segments, BLOCKS, start, self.progress, budget)
        if budget.cancel.cancelled:
            return False
        errors = [np.concatenate([each.reference_degC - each.estimate_degC for each in block]) for block in blocks]
        squares = tuple(float(np.nanmean(each**2)) for each in errors)
        self.tried.append(Choice(order, noise_degC, offset_degC, squares))
        self.unseen[self.tried[-1]] = [each for block in blocks for each in block]
        return True
