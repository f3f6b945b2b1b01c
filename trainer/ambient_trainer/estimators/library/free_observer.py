"""``free_observer``: a free linear filter of order 1 to 4 whose DC gains add up to one.

Its order and the noise it assumes are selected on the training data. It is fitted by its error of the ambient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimators.base import Effort, Estimator, Fit
from ambient_trainer.estimators.kalman.order import BLOCKS, ORDERS, Choice, Selection, constrained
from ambient_trainer.estimators.observer import filter_fit, late, with_fallbacks_and_variance
from ambient_trainer.estimators.training import Training, require_enough

NAMES = ("free_observer", "observer")
"""The second is the default's name, whichever kind it is."""
_FALLBACK_STARTS = 2


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
        require_enough(training.traces, FreeFilter(max(ORDERS), segments))
        selection = Selection(segments, effort, progress)
        choice = selection.run()
        if choice is None:
            order, result = selection.best_so_far()
            remark = f"Stopped before order and noise were selected: this is order {order}."
            return with_fallbacks_and_variance(_fit_of(training, order, result, effort), segments, (), None, remark, {})

        def fallback(dropped: int) -> Fit:
            fewer = replace(effort, starts=min(_FALLBACK_STARTS, effort.starts), pieces=1)
            return _fitted(training.without(dropped), choice, fewer, late(progress, effort))

        details = {"choice": choice.as_json(), "tried": [each.as_json() for each in selection.tried]}
        main = _fitted(training, choice, effort, progress)
        unseen, remark = selection.unseen[choice], _remark(choice, selection.tried)
        return with_fallbacks_and_variance(main, segments, unseen, fallback, remark, details)


def _fitted(training: Training, choice: Choice, effort: Effort, progress: Progress | None) -> Fit:
    structure = constrained(choice.order, training.segments, choice.noise_degC, choice.offset_degC)
    result = search(structure, effort.starts, effort.seed, progress, effort.budget)
    return _fit_of(training, choice.order, result, effort)


def _fit_of(training: Training, order: int, result: SearchResult, effort: Effort) -> Fit:
    return filter_fit(NAMES[0], training.columns, training.segments, order, result, effort)


def _remark(choice: Choice, tried: Sequence[Choice]) -> str:
    best = {order: min(each.rmse_degC for each in tried if each.order == order) for order in ORDERS}
    orders = ", ".join(f"{order}: {rmse:.3f}" for order, rmse in best.items())
    return (
        f"Selected on the training data alone, by {BLOCKS} blocks held out in turn: order {choice.order}, "
        f"{choice.noise_degC:g} degC of noise and an offset of {choice.offset_degC:g} degC assumed on every sensor, "
        f"{choice.rmse_degC:.3f} degC RMSE "
        f"(the best of each order: {orders})."
    )
