"""``free_observer``: the free linear filter that physics allows, its order and its noise chosen on the training data.

Of order 1 to 4, taught by its error of the ambient, its gains at rest adding up to one. What to choose is what predicts
blocks of the training data best that were left out; the lowest order, and then the most noise, within 1 % of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.assemble import StateSpace
from ambient_trainer.identify.fit import (
    Effort,
    Fit,
    Found,
    estimated,
    fit_of,
    require_enough,
    temperature_columns,
    training_segments,
)
from ambient_trainer.identify.free_filter import FreeFilter
from ambient_trainer.identify.search import Progress, search, search_whole
from ambient_trainer.identify.uncertainty import uncertainty
from ambient_trainer.kalman.finish import Member, Told, finished, judged, without
from ambient_trainer.kalman.free_structure import ConstrainedFilter
from ambient_trainer.kalman.reduce import at_rest
from ambient_trainer.traces.grid import Segment, sampling_period_s
from ambient_trainer.traces.trace import Trace

Array = NDArray[np.float64]

FREE_OBSERVER = "free_observer"
_ORDERS = (1, 2, 3, 4)
_NOISES_DEGC = (0.003, 0.01, 0.03, 0.1)
_BLOCKS = 5
_AS_GOOD = 1.01
_SCOUTS = 2
_FALLBACK_STARTS = 2


class Choice(NamedTuple):
    """An order and a noise, and the RMSE of blocks that a filter with them did not see."""

    order: int
    noise_degC: float
    rmse_degC: float


def fit_free_observer(
    traces: Sequence[Trace],
    effort: Effort,
    progress: Progress | None = None,
    period_s: float | None = None,
    inputs: Sequence[str] | None = None,
) -> Fit:
    """Fit the observer over ``inputs`` (trace columns; by default every temperature), and one without each of them."""
    columns = tuple(inputs or temperature_columns(traces))
    period = period_s or max(sampling_period_s(trace.time_s) for trace in traces)
    segments = training_segments(traces, columns, (REFERENCE,), period, effort.pieces)
    require_enough(traces, FreeFilter(max(_ORDERS), segments))
    with threadpool_limits(1):
        tried = _tried(segments, effort, progress)
        choice = chosen(tried)
        main = _fitted(columns, segments, choice, effort, progress)

        def fallback(dropped: int, progress: Progress | None) -> Fit:
            fewer = Effort(min(_FALLBACK_STARTS, effort.starts), effort.seed)
            return _fitted(*without(columns, segments, dropped), choice, fewer, progress)

        return finished(Member(main, segments), fallback, progress, _told(choice, tried))


def chosen(tried: Sequence[Choice]) -> Choice:
    """The lowest order, and of it the most noise, within 1 % of the best."""
    bar = _AS_GOOD * min(each.rmse_degC for each in tried)
    return min((each for each in tried if each.rmse_degC <= bar), key=lambda each: (each.order, -each.noise_degC))


def _tried(segments: Sequence[Segment], effort: Effort, progress: Progress | None) -> list[Choice]:
    """Every order with one noise, then every noise with the order that is chosen of these."""
    thetas: dict[int, Array] = {}

    def tried(order: int, noise_degC: float) -> Choice:
        if order not in thetas:
            starts = min(_SCOUTS, effort.starts)
            scouted = search_whole(ConstrainedFilter(order, segments, noise_degC), starts, effort.seed, progress)
            thetas[order] = scouted.best.theta
        blocks = range(_BLOCKS)
        errors = [_held_out(order, noise_degC, segments, block, thetas[order], progress) for block in blocks]
        return Choice(order, noise_degC, float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))))

    orders = [tried(order, _NOISES_DEGC[1]) for order in _ORDERS]
    order = chosen(orders).order
    return [*orders, *(tried(order, noise_degC) for noise_degC in _NOISES_DEGC if noise_degC != _NOISES_DEGC[1])]


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
    number = np.arange(sum(lengths)) * _BLOCKS // sum(lengths)
    return [part[None] == block for part in np.split(number, np.cumsum(lengths)[:-1])]


def _fitted(
    columns: Sequence[str], segments: Sequence[Segment], choice: Choice, effort: Effort, progress: Progress | None
) -> Fit:
    result = search(ConstrainedFilter(choice.order, segments, choice.noise_degC), effort.starts, effort.seed, progress)
    logged = FreeFilter(choice.order, segments)
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
        states=tuple(f"mode{index + 1}" for index in range(choice.order)),
        outputs=("ambient",),
    )
    return judged(fit, segments)


def _exact_at_rest(system: StateSpace) -> StateSpace:
    """The system whose gains at rest add up to one, not nearly so."""
    lacking = 1.0 - float(at_rest(system)[0].sum())
    return replace(system, D=system.D + lacking / system.D.shape[1])


def _told(choice: Choice, tried: Sequence[Choice]) -> Told:
    best = {order: min(each.rmse_degC for each in tried if each.order == order) for order in _ORDERS}
    orders = ", ".join(f"{order}: {rmse:.3f}" for order, rmse in best.items())
    remark = (
        f"Chosen on the training data alone, by {_BLOCKS} blocks left out in turn: order {choice.order}, "
        f"{choice.noise_degC:g} degC of noise presumed on every sensor, {choice.rmse_degC:.3f} degC RMSE "
        f"(the best of each order: {orders})."
    )
    return Told(remark, {"choice": choice._asdict(), "tried": [each._asdict() for each in tried]})
