"""A structure's held-out error: fitted anew without each block, from where the fit to everything ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.blocks import Block
from ambient_trainer.estimation.budget import Budget
from ambient_trainer.estimation.search import Solution, search
from ambient_trainer.estimation.structure import Expansion, Structure
from ambient_trainer.estimation.uncertainty import residuals

Array = NDArray[np.float64]

_WORST_DEGC2 = 1e12
"""Stands for the square of what is beyond any number."""


class Spending(NamedTuple):
    """How long to search: from how many places and evaluations for everything, and evaluations without a block."""

    starts: int
    whole: int
    without: int


@dataclass(frozen=True)
class Refitted:
    """The fit to everything, and per block the sum of squared errors in degC^2 of the fit without it."""

    solution: Solution
    squares: tuple[float, ...]


def refitted(structure: Structure, blocks: Sequence[Block], spending: Spending) -> Refitted:
    """Fit ``structure``, then the same without each block, which starts next to its end."""
    best = search(_Part(structure, None), spending.starts, 0, budget=Budget(spending.whole)).best
    squares = []
    for block in blocks:
        part = _Part(structure, block)
        part.search = replace(part.search, initial=best.theta)
        without = search(part, 1, 0, budget=Budget(spending.without)).best
        errors = residuals(structure, without)[block.segment][0, block.start : block.stop]
        square = float(np.nansum(errors**2))
        squares.append(square if np.isfinite(square) else _WORST_DEGC2)
    return Refitted(best, tuple(squares))


class _Part:
    """A structure whose filters run over everything, and which learns from the samples outside a block."""

    def __init__(self, structure: Structure, block: Block | None) -> None:
        self.structure = structure
        self.search = structure.search
        self.linear = structure.linear
        self._kept = [_kept(segment, index, block) for index, segment in enumerate(structure.segments)]
        self.segments: Sequence[Segment] = [
            Segment(each.period_s, each.inputs[:, kept], each.outputs[:, kept])
            for each, kept in zip(structure.segments, self._kept)
        ]

    def expand(self, theta: Array, period_s: float) -> Expansion:
        return self.structure.expand(theta, period_s)

    def signals(self, theta: Array, index: int) -> Array:
        return self.structure.signals(theta, index)[:, self._kept[index]]

    def excess(self, theta: Array) -> tuple[Array, Array]:
        return self.structure.excess(theta)

    def regrouped(self, theta: Array) -> Array:
        return self.structure.regrouped(theta)

    def random_start(self, random: np.random.Generator) -> Array:
        return self.structure.random_start(random)


def _kept(segment: Segment, index: int, block: Block | None) -> NDArray[np.bool_]:
    """The samples (N,) of a segment that teach."""
    kept = ~np.isnan(segment.outputs[0])
    if block is not None and block.segment == index:
        kept[block.first : block.last] = False
    return kept
