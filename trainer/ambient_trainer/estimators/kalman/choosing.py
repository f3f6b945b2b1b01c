"""Which order a free observer has, and how much noise it presumes: what predicts blocks best that were left out.

Of the training data alone; the lowest order, and then the most noise, within 1 % of the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.search import Progress, SearchResult, search, search_whole
from ambient_trainer.estimators.fit import Effort
from ambient_trainer.estimators.kalman.free_structure import ConstrainedFilter

Array = NDArray[np.float64]

ORDERS = (1, 2, 3, 4)
BLOCKS = 5
_NOISES_DEGC = (0.003, 0.01, 0.03, 0.1)
_FIRST_NOISE_DEGC = 0.01
_AS_GOOD = 1.01
_SCOUTS = 2
"""Starts of the search on the whole training data, from whose end those without a block begin."""


class Choice(NamedTuple):
    """An order and a noise, and the RMSE of blocks that a filter with them did not see."""

    order: int
    noise_degC: float
    rmse_degC: float


def chosen(tried: Sequence[Choice]) -> Choice:
    """The lowest order, and of it the most noise, within 1 % of the best."""
    bar = _AS_GOOD * min(each.rmse_degC for each in tried)
    return min((each for each in tried if each.rmse_degC <= bar), key=lambda each: (each.order, -each.noise_degC))


class Choosing:
    """The choice, as far as it has come."""

    def __init__(self, segments: Sequence[Segment], effort: Effort, progress: Progress | None) -> None:
        self.segments = segments
        self.effort = effort
        self.progress = progress
        self.tried: list[Choice] = []
        self._scouted: dict[int, SearchResult] = {}

    def run(self) -> Choice:
        """Try every order with one noise, then every noise with the order that is chosen of these."""
        for order in ORDERS:
            self._try(order, _FIRST_NOISE_DEGC)
        order = chosen(self.tried).order
        for noise_degC in _NOISES_DEGC:
            if noise_degC != _FIRST_NOISE_DEGC:
                self._try(order, noise_degC)
        return chosen(self.tried)

    def best_so_far(self) -> tuple[int, SearchResult]:
        """The order to take, and what was found of it, after a KeyboardInterrupt; raises that where there is none."""
        if not self._scouted:
            raise KeyboardInterrupt
        order = chosen(self.tried).order if self.tried else min(self._scouted)
        return order, replace(self._scouted[order], stopped=True)

    def _try(self, order: int, noise_degC: float) -> None:
        if order not in self._scouted:
            structure = ConstrainedFilter(order, self.segments, noise_degC)
            starts = min(_SCOUTS, self.effort.starts)
            self._scouted[order] = search(structure, starts, self.effort.seed, self.progress)
        found = self._scouted[order]
        if found.stopped:
            raise KeyboardInterrupt
        errors = [
            _held_out(order, noise_degC, self.segments, block, found.best.theta, self.progress)
            for block in range(BLOCKS)
        ]
        self.tried.append(Choice(order, noise_degC, float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))))


def _held_out(
    order: int, noise_degC: float, segments: Sequence[Segment], block: int, theta: Array, progress: Progress | None
) -> Array:
    """The errors over one block of the reference, of a filter that ran through it and was not taught by it."""
    hidden, kept = [], []
    for each, mask in zip(segments, _block_masks(segments, block)):
        hidden.append(np.where(mask, each.outputs, np.nan))
        kept.append(Segment(each.period_s, each.inputs, np.where(mask, np.nan, each.outputs)))
    structure = ConstrainedFilter(order, kept, noise_degC)
    structure.search = replace(structure.search, initial=theta)
    best = search_whole(structure, 1, 0, progress).best
    weights = structure.expand(best.theta, segments[0].period_s).free[0] @ best.beta
    return np.concatenate(
        [rows[0] - weights @ structure.signals(best.theta, index) for index, rows in enumerate(hidden)]
    )


def _block_masks(segments: Sequence[Segment], block: int) -> list[NDArray[np.bool_]]:
    """Which samples of each segment (1, N) belong to a block of successive samples of all of them."""
    lengths = [each.inputs.shape[1] for each in segments]
    number = np.arange(sum(lengths)) * BLOCKS // sum(lengths)
    return [part[None] == block for part in np.split(number, np.cumsum(lengths)[:-1])]
