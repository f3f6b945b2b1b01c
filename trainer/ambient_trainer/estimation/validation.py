"""Cross-validation errors on blocks of time that a fit has not used.

:func:`cut_in_blocks` leaves a gap on either side, for whole estimators: errors are autocorrelated. :func:`held_out`,
for orders and intervals, takes successive blocks of all segments together, without a gap.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation.error_variance import Moment
from ambient_trainer.estimation.search import Budget, Progress, Solution, search
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.uncertainty import residuals

_GAP_SHARE = 0.1
_WORST_DEGC2 = 1e12
"""Stands for the square of what is beyond any number."""


class Block(NamedTuple):
    """Samples ``start`` to ``stop`` of a segment are held out; ``first`` to ``last`` train nothing."""

    segment: int
    start: int
    stop: int
    first: int
    last: int


def cut_in_blocks(segments: Sequence[Segment], count: int, gap_s: float | None, source: str) -> tuple[Block, ...]:
    """About ``count`` blocks of equal length, none over the end of a segment; the gap defaults to a tenth of one.

    Raises :class:`Refused` where fewer than two hold any reference.
    """
    total = sum(each.inputs.shape[1] for each in segments)
    blocks = []
    for index, segment in enumerate(segments):
        length = segment.inputs.shape[1]
        pieces = max(1, round(count * length / total))
        gap = round(_GAP_SHARE * length / pieces if gap_s is None else gap_s / segment.period_s)
        edges = np.linspace(0, length, pieces + 1).astype(int).tolist()
        for start, stop in pairwise(edges):
            if not np.isnan(segment.outputs[0, start:stop]).all():
                blocks.append(Block(index, start, stop, max(0, start - gap), min(length, stop + gap)))
    if len(blocks) < 2:
        raise refuse(source, "", "the reference fills less than two blocks", "log longer, or ask for more --blocks")
    return tuple(blocks)


def held_out(
    structure_of: Callable[[Sequence[Segment]], Structure],
    segments: Sequence[Segment],
    count: int,
    start: Array,
    progress: Progress | None,
    budget: Budget,
) -> list[list[Moment]]:
    """The estimates over ``count`` blocks, the last two as one, of filters that were not trained on them.

    Blocks have as many samples with a reference each, of the segments in their order; that of the last two foretells
    what comes later. A search begins at ``start``. Cancelled, the blocks that are not done are left out.
    """
    known = [~np.isnan(each.outputs[0]) for each in segments]
    before = np.cumsum(np.concatenate(known)) - np.concatenate(known)
    number = np.minimum(before * count // sum(map(np.count_nonzero, known)), count - 2)
    blocks = []
    for block in np.unique(number):
        masks = np.split(number == block, np.cumsum([len(each) for each in known])[:-1])
        hidden = [np.where(mask, each.outputs[0], np.nan) for each, mask in zip(segments, masks)]
        kept = [replace(s, outputs=np.where(mask, np.nan, s.outputs)) for s, mask in zip(segments, masks)]
        structure = structure_of(kept)
        structure.search = replace(structure.search, initial=start)
        best = search(structure, 1, 0, progress, budget).best
        if budget.cancelled:
            break
        estimates = (structure.predicted(best.theta, best.beta, index)[0] for index in range(len(hidden)))
        blocks.append([Moment(*each) for each in zip(estimates, hidden)])
    return blocks


def refitted(
    structure: Structure, blocks: Sequence[Block], starts: int, whole: int, without_one: int
) -> tuple[Solution, tuple[float, ...]]:
    """Fit ``structure``, then without each block from where that ended: the fit, and each block's sum of squares.

    From so many places and with so many evaluations the ``whole``, with ``without_one`` each without a block.
    """
    best = search(structure, starts, 0, budget=Budget(whole)).best
    squares = []
    for block in blocks:
        # its filters run over everything, and it is fitted to the samples outside the block
        part, segments = copy.copy(structure), list(structure.segments)
        outputs = segments[block.segment].outputs.copy()
        outputs[:, block.first : block.last] = np.nan
        segments[block.segment] = replace(segments[block.segment], outputs=outputs)
        part.segments, part.search = segments, replace(part.search, initial=best.theta)
        without = search(part, 1, 0, budget=Budget(without_one)).best
        errors = residuals(structure, without)[block.segment][0, block.start : block.stop]
        squares.append(float(min(np.nansum(errors**2), _WORST_DEGC2)))
    return best, tuple(squares)
