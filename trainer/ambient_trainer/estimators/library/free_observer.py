"""``free_observer``: a free linear filter of order 1 to 4 whose DC gains add up to one.

Its order and the noise it assumes are selected on the training data. It is fitted by its error of the ambient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimators.base import USUAL, Effort, Fit
from ambient_trainer.estimators.kalman.constrained_filter import ConstrainedFilter
from ambient_trainer.estimators.kalman.order import BLOCKS, ORDERS, Choice, Selection
from ambient_trainer.estimators.observer import late, rescored, with_fallbacks_and_variance, without
from ambient_trainer.estimators.searched import MODES, filter_parameters, fit_of, with_uncertainty
from ambient_trainer.estimators.training import estimator_data, require_enough
from ambient_trainer.lti.statespace import StateSpace, dc_gain

NAMES = ("free_observer",)
_FALLBACK_STARTS = 2


def find(name: str) -> FreeObserver | None:
    """The estimator called ``name``, or None."""
    return FreeObserver() if name in NAMES else None


@dataclass(frozen=True)
class FreeObserver:
    """Fits the observer, and one without each of its inputs."""

    name = NAMES[0]
    reads_any = True

    def searches(self, effort: Effort) -> int:
        """One a start."""
        return effort.starts

    def fit(
        self,
        traces: Sequence[Trace],
        effort: Effort = USUAL,
        progress: Progress | None = None,
        period_s: float | None = None,
        inputs: Sequence[str] | None = None,
    ) -> Fit:
        """Fit; see :class:`ambient_trainer.estimators.base.Estimator`.

        Cancelled before order and noise are selected, it keeps the best of what was tried.
        """
        columns, segments = estimator_data(traces, inputs, period_s, effort.pieces)
        require_enough(traces, FreeFilter(max(ORDERS), segments))
        with threadpool_limits(1):
            selection = Selection(segments, effort, progress)
            choice = selection.run()
            if choice is None:
                order, result = selection.best_so_far()
                fit = _fit_of(columns, segments, order, result, effort)
                remark = f"Stopped before order and noise were selected: this is order {order}."
                return with_fallbacks_and_variance(fit, segments, None, remark, {})
            main = _fitted(columns, segments, choice, effort, progress)

            def fallback(dropped: int) -> Fit:
                fewer = replace(effort, starts=min(_FALLBACK_STARTS, effort.starts), pieces=1)
                return _fitted(*without(columns, segments, dropped), choice, fewer, late(progress, effort))

            tried = [each._asdict() for each in selection.tried]
            details = {"choice": choice._asdict(), "tried": tried}
            return with_fallbacks_and_variance(main, segments, fallback, _remark(choice, selection.tried), details)


def _fitted(
    columns: Sequence[str], segments: Sequence[Segment], choice: Choice, effort: Effort, progress: Progress | None
) -> Fit:
    structure = ConstrainedFilter(choice.order, segments, choice.noise_degC)
    result = search(structure, effort.starts, effort.seed, progress, effort.budget)
    return _fit_of(columns, segments, choice.order, result, effort)


def _fit_of(
    columns: Sequence[str], segments: Sequence[Segment], order: int, result: SearchResult, effort: Effort
) -> Fit:
    logged = FreeFilter(order, segments)
    best = result.best
    found = with_uncertainty(logged, result, effort)
    system = _of_unit_dc_gain(logged.system(best.theta, best.beta))
    parameters = filter_parameters(logged, found)
    fit = fit_of(found, system, parameters, circuit=NAMES[0], inputs=columns, states=MODES[:order])
    return rescored(fit, segments)


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
