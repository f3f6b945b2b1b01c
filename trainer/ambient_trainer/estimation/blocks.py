"""Held out are blocks of time; what lies within a gap of one teaches nothing either, as errors remember.

Sensor readings before a block may run into its filters, as on a device; the reference never does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data.grid import Segment

_GAP_SHARE = 0.1


@dataclass(frozen=True)
class Block:
    """Samples ``start`` to ``stop`` of a segment are held out; ``first`` to ``last`` do not teach."""

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
    found = []
    for index, segment in enumerate(segments):
        length = segment.inputs.shape[1]
        pieces = max(1, round(count * length / total))
        gap = round(_GAP_SHARE * length / pieces if gap_s is None else gap_s / segment.period_s)
        edges = np.linspace(0, length, pieces + 1).astype(int).tolist()
        for start, stop in pairwise(edges):
            if not np.isnan(segment.outputs[0, start:stop]).all():
                found.append(Block(index, start, stop, max(0, start - gap), min(length, stop + gap)))
    if len(found) < 2:
        raise refuse(source, "", "the reference fills less than two blocks", "log longer, or ask for more --blocks")
    return tuple(found)
