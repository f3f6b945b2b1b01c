"""The constrained free filter, and its order and assumed sensor noise, selected by the error over held-out blocks.

The blocks are of the training data. The lowest order, and then the most noise, within 1 % of the best is selected. Two
constraints of physics are synthetic runs that the filter is fitted to like any other:

- All sensors one degree up is the estimate one degree up: from a run in which every sensor shows one value, always.
- White noise on the sensors, beyond the logged: from an impulse of each sensor alone, whose target is zero. What is
  left is the impulse response, whose square sum is the square of the noise gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimation.validation import successive_masks
from ambient_trainer.estimators.base import Effort

Array = NDArray[np.float64]

_STEADY = 8
"""Samples of the run at a constant level: as many as a filter's delays need."""
_IMPULSE = 300
"""Samples of an impulse response; what comes later is small and slow."""


class ConstrainedFilter(FreeFilter):
    """The free filter of order N over segments, as if each sensor had ``noise_degC`` more white noise than logged."""

    def __init__(self, order: int, logged: Sequence[Segment], noise_degC: float) -> None:
        period_s, inputs = logged[0].period_s, logged[0].inputs.shape[0]
        known = np.concatenate([each.outputs[0] for each in logged])
        known = known[~np.isnan(known)]
        size = float(np.linalg.norm(known))
        level = Segment(
            period_s, np.full((inputs, _STEADY), size), np.where(np.arange(_STEADY) > 0, np.nan, size)[None]
        )
        length = min(_IMPULSE, max(each.inputs.shape[1] for each in logged))
        impulse = noise_degC * np.sqrt(len(known))
        impulses = [_impulse(period_s, inputs, index, impulse, length) for index in range(inputs)]
        super().__init__(order, [*logged, level, *impulses])
        self.logged = len(logged)

    def signals(self, theta: Array, index: int) -> Array:
        """As the free filter's; the constraints have no offset."""
        found = super().signals(theta, index)
        if index >= self.logged:
            found[self.inputs] = 0.0
        return found


def _impulse(period_s: float, inputs: int, index: int, impulse: float, length: int) -> Segment:
    u = np.zeros((inputs, length))
    # the first sample sets the equilibrium
    u[index, 1] = impulse
    return Segment(period_s, u, np.zeros((1, length)))


ORDERS = (1, 2, 3, 4)
BLOCKS = 5
_NOISES_DEGC = (0.003, 0.01, 0.03, 0.1)
_FIRST_NOISE_DEGC = 0.01
_AS_GOOD = 1.01
_FIRST_STARTS = 2
"""Starts of the search on the whole training data, from whose end those without a block start."""


class Choice(NamedTuple):
    """An order and a noise, and the RMSE of blocks that a filter with them did not see."""

    order: int
    noise_degC: float
    rmse_degC: float


def selected(tried: Sequence[Choice]) -> Choice:
    """The lowest order, and of it the most noise, within 1 % of the best."""
    bar = _AS_GOOD * min(each.rmse_degC for each in tried)
    return min((each for each in tried if each.rmse_degC <= bar), key=lambda each: (each.order, -each.noise_degC))


class Selection:
    """The selection, as far as it has come."""

    def __init__(self, segments: Sequence[Segment], effort: Effort, progress: Progress | None) -> None:
        self.segments = segments
        self.effort = effort
        self.progress = progress
        self.tried: list[Choice] = []
        self._whole: dict[int, SearchResult] = {}

    def run(self) -> Choice | None:
        """Try every order with one noise, then every noise with the order selected of these; None where cancelled."""
        for order in ORDERS:
            if not self._try(order, _FIRST_NOISE_DEGC):
                return None
        order = selected(self.tried).order
        for noise_degC in _NOISES_DEGC:
            if noise_degC != _FIRST_NOISE_DEGC and not self._try(order, noise_degC):
                return None
        return selected(self.tried)

    def best_so_far(self) -> tuple[int, SearchResult]:
        """The order to take where :meth:`run` was cancelled, and its search."""
        order = selected(self.tried).order if self.tried else min(self._whole)
        return order, replace(self._whole[order], stopped=True)

    def _try(self, order: int, noise_degC: float) -> bool:
        """Whether order and noise were scored before the search was cancelled."""
        if order not in self._whole:
            structure = ConstrainedFilter(order, self.segments, noise_degC)
            starts = min(_FIRST_STARTS, self.effort.starts)
            self._whole[order] = search(structure, starts, self.effort.seed, self.progress, self.effort.budget)
        errors = []
        for masks in successive_masks(self.segments, BLOCKS):
            if self._whole[order].stopped:
                return False
            errors.append(self._held_out(order, noise_degC, masks))
        if self.effort.budget.cancel.cancelled:
            return False
        self.tried.append(Choice(order, noise_degC, float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))))
        return True

    def _held_out(self, order: int, noise_degC: float, masks: Sequence[NDArray[np.bool_]]) -> Array:
        """The errors over one block of the reference, of a filter that ran through it and was not trained on it."""
        hidden, kept = [], []
        for each, mask in zip(self.segments, masks):
            hidden.append(np.where(mask, each.outputs, np.nan))
            kept.append(Segment(each.period_s, each.inputs, np.where(mask, np.nan, each.outputs)))
        structure = ConstrainedFilter(order, kept, noise_degC)
        structure.search = replace(structure.search, initial=self._whole[order].best.theta)
        best = search(structure, 1, 0, self.progress, self.effort.budget).best
        weights = structure.expand(best.theta, structure.period_s).free[0] @ best.beta
        return np.concatenate(
            [rows[0] - weights @ structure.signals(best.theta, index) for index, rows in enumerate(hidden)]
        )
