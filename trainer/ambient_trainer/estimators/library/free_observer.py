"""``free_observer``: a free linear filter of order 1 to 4 whose DC gains add up to one.

Its order and the noise it assumes are selected on the training data. It is fitted by its error of the ambient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimators.base import Effort, FilterEstimator, Fit
from ambient_trainer.estimators.kalman.order import BLOCKS, ORDERS, Choice, ConstrainedFilter, Selection
from ambient_trainer.estimators.observer import late, rescored, with_fallbacks_and_variance
from ambient_trainer.estimators.searched import MODES, filter_parameters, fit_of, with_uncertainty
from ambient_trainer.estimators.training import Training, require_enough
from ambient_trainer.lti.statespace import StateSpace, dc_gain

NAMES = ("free_observer",)
_FALLBACK_STARTS = 2


def find(name: str) -> FreeObserver | None:
    """The estimator called ``name``, or None."""
    return FreeObserver() if name in NAMES else None


class FreeObserver(FilterEstimator):
    """Fits the observer, and one without each of its inputs."""

    name = NAMES[0]

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns.

        Cancelled before order and noise are selected, it keeps the best of what was tried.
        """
        segments = training.segments
        require_enough(training.source, FreeFilter(max(ORDERS), segments))
        selection = Selection(segments, effort, progress)
        choice = selection.run()
        if choice is None:
            order, result = selection.best_so_far()
            remark = f"Stopped before order and noise were selected: this is order {order}."
            return with_fallbacks_and_variance(_fit_of(training, order, result, effort), segments, None, remark, {})

        def fallback(dropped: int) -> Fit:
            fewer = replace(effort, starts=min(_FALLBACK_STARTS, effort.starts), pieces=1)
            return _fitted(training.without(dropped), choice, fewer, late(progress, effort))

        details = {"choice": choice._asdict(), "tried": [each._asdict() for each in selection.tried]}
        main = _fitted(training, choice, effort, progress)
        return with_fallbacks_and_variance(main, segments, fallback, _remark(choice, selection.tried), details)


def _fitted(training: Training, choice: Choice, effort: Effort, progress: Progress | None) -> Fit:
    structure = ConstrainedFilter(choice.order, training.segments, choice.noise_degC)
    result = search(structure, effort.starts, effort.seed, progress, effort.budget)
    return _fit_of(training, choice.order, result, effort)


def _fit_of(training: Training, order: int, result: SearchResult, effort: Effort) -> Fit:
    logged, best = FreeFilter(order, training.segments), result.best
    found = with_uncertainty(logged, result, effort)
    system = _of_unit_dc_gain(logged.system(best.theta, best.beta))
    parameters = filter_parameters(logged, found)
    fit = fit_of(found, system, parameters, circuit=NAMES[0], inputs=training.columns, states=MODES[:order])
    return rescored(fit, training.segments)


def _of_unit_dc_gain(system: StateSpace) -> StateSpace:
    """The system whose DC gains add up to one exactly, which the search does nearly."""
    lacking = 1.0 - float(dc_gain(system)[0].sum())
    return replace(system, D=system.D + lacking / system.D.shape[1])


def _remark(choice: Choice, tried: Sequence[Choice]) -> str:
    best = {order: min(each.rmse_degC for each in tried if each.order == order) for order in ORDERS}
    orders = ", ".join(f"{order}: {rmse:.3f}" for order, rmse in best.items())
    return (
        f"Selected on the training data alone, by {BLOCKS} blocks held out in turn: order {choice.order}, "
        f"{choice.noise_degC:g} degC of noise assumed on every sensor, {choice.rmse_degC:.3f} degC RMSE "
        f"(the best of each order: {orders})."
    )
