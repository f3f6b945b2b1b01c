"""``free_observer``: the free linear filter that physics allows, its order and its noise chosen on the training data.

Of order 1 to 4, taught by its error of the ambient, its gains at rest adding up to one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimation.uncertainty import uncertainty
from ambient_trainer.estimators.fit import (
    Effort,
    Fit,
    Found,
    estimated,
    estimator_data,
    fit_of,
    require_enough,
)
from ambient_trainer.estimators.kalman.assemble import Member, Told, finished, judged, late, without
from ambient_trainer.estimators.kalman.choosing import BLOCKS, ORDERS, Choice, Choosing
from ambient_trainer.estimators.kalman.free_structure import ConstrainedFilter
from ambient_trainer.lti.reduce import at_rest
from ambient_trainer.lti.statespace import StateSpace

Array = NDArray[np.float64]

FREE_OBSERVER = "free_observer"
_FALLBACK_STARTS = 2


def fit_free_observer(
    traces: Sequence[Trace],
    effort: Effort,
    progress: Progress | None = None,
    period_s: float | None = None,
    inputs: Sequence[str] | None = None,
) -> Fit:
    """Fit the observer over ``inputs`` (trace columns; by default every temperature), and one without each of them.

    Cancelled before all is chosen, it keeps the best of what was tried.
    """
    columns, segments = estimator_data(traces, inputs, period_s, effort.pieces)
    require_enough(traces, FreeFilter(max(ORDERS), segments))
    with threadpool_limits(1):
        choosing = Choosing(segments, effort, progress)
        choice = choosing.run()
        if choice is None:
            order, result = choosing.best_so_far()
            fit = _fit_of(columns, segments, order, result, effort)
            remark = f"Stopped before order and noise were chosen: this is order {order}."
            return finished(Member(fit, segments), None, Told(remark, {}))
        main = _fitted(columns, segments, choice, effort, progress)

        def fallback(dropped: int) -> Fit:
            fewer = replace(effort, starts=min(_FALLBACK_STARTS, effort.starts), pieces=1)
            return _fitted(*without(columns, segments, dropped), choice, fewer, late(progress, effort))

        return finished(Member(main, segments), fallback, _told(choice, choosing.tried))


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
    found = Found(logged, result, uncertainty(logged, best), effort)
    poles = zip(logged.search.names, np.exp(best.theta).tolist())
    fit = fit_of(
        found,
        _exact_at_rest(logged.system(best.theta, best.beta)),
        tuple(estimated(name, "1" if "zeta" in name else "1/s", value, True, found.known) for name, value in poles),
        circuit=FREE_OBSERVER,
        hold="first-order",
        inputs=tuple(columns),
        states=tuple(f"mode{index + 1}" for index in range(order)),
        outputs=("ambient",),
    )
    return judged(fit, segments)


def _exact_at_rest(system: StateSpace) -> StateSpace:
    """The system whose gains at rest add up to one, not nearly so."""
    lacking = 1.0 - float(at_rest(system)[0].sum())
    return replace(system, D=system.D + lacking / system.D.shape[1])


def _told(choice: Choice, tried: Sequence[Choice]) -> Told:
    best = {order: min(each.rmse_degC for each in tried if each.order == order) for order in ORDERS}
    orders = ", ".join(f"{order}: {rmse:.3f}" for order, rmse in best.items())
    remark = (
        f"Chosen on the training data alone, by {BLOCKS} blocks left out in turn: order {choice.order}, "
        f"{choice.noise_degC:g} degC of noise presumed on every sensor, {choice.rmse_degC:.3f} degC RMSE "
        f"(the best of each order: {orders})."
    )
    return Told(remark, {"choice": choice._asdict(), "tried": [each._asdict() for each in tried]})
