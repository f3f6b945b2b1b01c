"""``free_observer``: a free linear filter of order 1 to 4, fitted by its error.

Its order, and the noise and the offset that it assumes of every sensor, are selected by the error over blocks of the
training data that are held out: the lowest order, then the most noise, then the largest offset whose error is not
significantly above the best. Its DC gains add up to one, as physics demands of what takes on the ambient at rest,
unless much less of the error is left without: what a controller heats shows little of the ambient's level.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import gmean

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation import FreeFilter, MultistartResult, Progress, WeightedRun, search, weighted_filter
from ambient_trainer.estimation.error_variance import Moment
from ambient_trainer.estimation.validation import held_out
from ambient_trainer.estimators.base import Effort, Estimator, Fit, Training, require_enough
from ambient_trainer.estimators.searched import filter_fit, late, with_fallbacks_and_variance

NAMES = ("free_observer", "observer")
"""The second is the default's name, whichever kind it is."""
_ORDERS = (1, 2, 3, 4)
_BLOCKS = 5
_NOISES_DEGC = (0.003, 0.01, 0.03, 0.1)
_OFFSETS_DEGC = (0.0, 0.1, 0.3, 1.0)
"""Up to what uncalibrated thermistors and thermocouples are off by."""
_FIRST_NOISE_DEGC = 0.01
_HELD = 10.0
"""Times the weight of all readings: that DC gains add up to one."""
_AS_GOOD = 1.02
"""Of mean squares: 1 % of the error."""
_FIRST_STARTS = 2
"""Starts of the search on the whole training data, from whose end those without a block start."""
_FALLBACK_STARTS = 2
_FREED = 0.7
"""Of the error, as the blocks have it on the average: no more has to be left by DC gains that do not add up to one.
Chosen on 47 of 89 measured logs; two of the others moved, both for the better."""
_FREE_GAINS = " Its DC gains do not add up to one: these sensors show little of the ambient's level."


def find(name: str) -> FreeObserver | None:
    """The estimator called ``name``, or None."""
    return FreeObserver() if name in NAMES else None


class FreeObserver(Estimator):
    """Fits the observer, and one without each of its inputs."""

    name = NAMES[0]

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns.

        Cancelled before order and noise are selected, it keeps the best of what was tried.
        """
        segments = training.segments
        require_enough(training.traces, FreeFilter(max(_ORDERS), segments))
        selection = _Selection(segments, effort, progress)
        choice = selection.run()
        if choice is None:
            held = [each for each in selection.tried if each.unit_gain]
            order = selected(held).order if held else min(selection.whole)[1]
            result = replace(selection.whole[True, order], stopped=True)
            remark = f"Stopped before order and noise were selected: this is order {order}."
            main = filter_fit(self.name, training, order, result, effort)
            return with_fallbacks_and_variance(main, segments, (), None, remark, {})

        def fitted(training: Training, effort: Effort, progress: Progress | None) -> Fit:
            structure = constrained(training.segments, *choice[:4])
            result = search(structure, effort.starts, effort.seed, progress, effort.budget)
            return filter_fit(self.name, training, choice.order, result, effort, choice.unit_gain)

        def fallback(dropped: int) -> Fit:
            fewer = replace(effort, starts=min(_FALLBACK_STARTS, effort.starts), pieces=1)
            return fitted(training.without(dropped), fewer, late(progress, effort))

        main, tried = fitted(training, effort, progress), selection.tried
        details = {"choice": choice.as_json(), "tried": [each.as_json() for each in tried]}
        alike = [each for each in tried if each.unit_gain == choice.unit_gain]
        best = {order: min(each.rmse_degC for each in alike if each.order == order) for order in _ORDERS}
        remark = (
            f"Selected on the training data alone, by {_BLOCKS} blocks held out in turn, the last two together: "
            f"order {choice.order}, "
            f"{choice.noise_degC:g} degC of noise and an offset of {choice.offset_degC:g} degC assumed on every "
            f"sensor, {choice.rmse_degC:.3f} degC RMSE (the best of each order: "
            f"{', '.join(f'{order}: {rmse:.3f}' for order, rmse in best.items())})."
            f"{_FREE_GAINS * (not choice.unit_gain)}"
        )
        unseen, offset_degC = tried[choice], choice.offset_degC
        return with_fallbacks_and_variance(main, segments, unseen, fallback, remark, details, offset_degC)


def constrained(
    logged: Sequence[Segment], unit_gain: bool, order: int, noise_degC: float, offset_degC: float = 0.0
) -> FreeFilter:
    """The free filter of order N over segments, as if each sensor had more white noise and a larger offset than logged.

    Both are standard deviations. With ``unit_gain`` all sensors one degree up is the estimate one degree up.
    """
    known = np.concatenate([each.outputs[0] for each in logged])
    known = known[~np.isnan(known)]
    root, runs = float(np.sqrt(len(known))), [WeightedRun(each, 1.0, True) for each in logged]
    # what is exported has them exactly: what they lack here would move the estimate by as much of the readings' level
    demanded = _HELD * float(np.linalg.norm([np.linalg.norm(each.inputs) for each in logged])) * unit_gain
    return weighted_filter(order, runs, demanded, noise_degC * root, offset_degC * root)


class Choice(NamedTuple):
    """Whether DC gains add up to one, order, noise and offset, and the mean square of each block, by a filter that did
    not see it."""

    unit_gain: bool
    order: int
    noise_degC: float
    offset_degC: float
    squares_degC2: tuple[float, ...]

    def as_json(self) -> dict[str, float]:
        """For the provenance."""
        return {**dict(zip(self._fields[:4], self[:4])), "rmse_degC": self.rmse_degC}

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
        return bool(above.mean() <= max((_AS_GOOD - 1) * best.mean(), above.std(ddof=1) / np.sqrt(len(above))))

    return min(filter(good, tried), key=lambda each: (each.order, -each.noise_degC, -each.offset_degC))


class _Selection:
    """The selection, as far as it has come: per choice the estimates over blocks that were left out."""

    def __init__(self, segments: Sequence[Segment], effort: Effort, progress: Progress | None) -> None:
        self.segments, self.effort, self.progress = segments, effort, progress
        self.tried: dict[Choice, list[Moment]] = {}
        self.whole: dict[tuple[bool, int], MultistartResult] = {}

    def run(self) -> Choice | None:
        """What is selected of all that was tried; None where that was cancelled."""
        if not all(self._try(*each) for each in self._grid()):
            return None
        held, free = self._best(unit_gain=True), self._best(unit_gain=False)
        less = np.divide(free.squares_degC2, held.squares_degC2)
        # where its lowest order did no better, no other was tried
        return free if free.rmse_degC < held.rmse_degC and np.sqrt(gmean(less)) < _FREED else held

    def _grid(self) -> Iterator[tuple[bool, int, float, float]]:
        """With DC gains that add up to one, and then with free ones where the lowest order of these does better."""
        yield from self._grid_of(True, _ORDERS)
        lowest, *others = _ORDERS
        yield False, lowest, _FIRST_NOISE_DEGC, 0.0
        if self._best(unit_gain=False).rmse_degC < self._best(unit_gain=True).rmse_degC:
            yield from self._grid_of(False, others)

    def _grid_of(self, unit_gain: bool, orders: Sequence[int]) -> Iterator[tuple[bool, int, float, float]]:
        """Each of the orders, with that selected every noise, and with that every offset."""
        yield from ((unit_gain, order, _FIRST_NOISE_DEGC, 0.0) for order in orders)
        best = self._best(unit_gain)
        yield from ((unit_gain, best.order, each, 0.0) for each in _NOISES_DEGC if each != best.noise_degC)
        best = self._best(unit_gain)
        yield from ((unit_gain, best.order, best.noise_degC, each) for each in _OFFSETS_DEGC[1:])

    def _best(self, unit_gain: bool) -> Choice:
        return selected([each for each in self.tried if each.unit_gain == unit_gain])

    def _try(self, unit_gain: bool, order: int, noise_degC: float, offset_degC: float) -> bool:
        """Whether these were scored before the search was cancelled."""
        budget, kind = self.effort.budget, (unit_gain, order)
        if kind not in self.whole:
            structure, starts = constrained(self.segments, *kind, noise_degC), min(_FIRST_STARTS, self.effort.starts)
            self.whole[kind] = search(structure, starts, self.effort.seed, self.progress, budget)
        if self.whole[kind].stopped:
            return False

        def without(kept: Sequence[Segment]) -> FreeFilter:
            return constrained(kept, *kind, noise_degC, offset_degC)

        start = self.whole[kind].best.theta
        blocks = held_out(without, self.segments, _BLOCKS, start, self.progress, budget)
        if budget.cancelled:
            return False
        errors = [np.concatenate([each.reference_degC - each.estimate_degC for each in block]) for block in blocks]
        squares = tuple(float(np.nanmean(each**2)) for each in errors)
        self.tried[Choice(*kind, noise_degC, offset_degC, squares)] = [each for block in blocks for each in block]
        return True
