"""A structure is what can be fitted: outputs that are linear in some unknowns and not in the others.

At search parameters theta its outputs over a segment are

    y_o = S' (f_o + F_o beta),

S (s, N) being signals filtered from the inputs at the structure's poles. Derivatives in theta are combinations of the
same signals. So no residual of N samples is ever formed in the search: one QR factorisation of [S' Y'] shrinks
everything to s + q rows, with the same inner products.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeqrf

from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Array

_BLOCK_SAMPLES = 2048


@dataclass(frozen=True)
class Unknowns:
    """Names, bounds and starting values of a set of unknowns, each of shape (count,)."""

    names: tuple[str, ...]
    initial: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class Expansion:
    """What signals S make the outputs: coefficients fixed (q, s), free (q, s, p), and their theta-derivatives."""

    fixed: Array
    free: Array
    fixed_slope: Array
    """(P, q, s)"""
    free_slope: Array
    """(P, q, s, p)"""


class Structure(Protocol):
    """What the search needs to know of a model."""

    search: Unknowns
    """theta, in the coordinates of the search."""
    linear: Unknowns
    """beta; ``initial`` is not used."""
    segments: Sequence[Segment]

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """The coefficients at ``theta`` for segments of this period."""

    def signals(self, theta: Array, index: int) -> Array:
        """The signals S (s, N) of segment ``index`` at ``theta``."""

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """By how much theta leaves what is plausible: (c,), zero where it does not, and its Jacobian (c, P)."""

    def regrouped(self, theta: Array) -> Array:
        """The same point in better coordinates, where there are any; else theta itself."""

    def random_start(self, random: np.random.Generator) -> Array:
        """Another theta to start from, within the bounds."""


@dataclass(frozen=True)
class Linearised:
    """The least-squares problem at one theta, in compressed rows: target ~ fixed + free beta."""

    target: Array
    """(r,)"""
    fixed: Array
    """(r,)"""
    free: Array
    """(r, p)"""
    fixed_slope: Array
    """(P, r)"""
    free_slope: Array
    """(P, r, p)"""


def linearise(structure: Structure, theta: Array) -> Linearised:
    """The compressed least-squares problem of ``structure`` at ``theta`` over all its segments."""
    parts = []
    for period_s in sorted({segment.period_s for segment in structure.segments}):
        expansion, used = _used(structure.expand(theta, period_s))
        factors = _factors(structure, theta, period_s, used)
        for output, (R, target) in enumerate(factors):
            fixed, free = R @ expansion.fixed[output], R @ expansion.free[output]
            slopes = expansion.fixed_slope[:, output] @ R.T, R @ expansion.free_slope[:, output]
            parts.append((target, fixed, free, *slopes))
    return Linearised(*(np.concatenate(each, axis=axis) for each, axis in zip(zip(*parts), (0, 0, 0, 1, 1))))


def _used(expansion: Expansion) -> tuple[Expansion, NDArray[np.bool_]]:
    """The expansion without the signals that no output and no derivative has a share of, and which are left (s,)."""
    used: NDArray[np.bool_] = np.logical_or(expansion.fixed.any(axis=0), expansion.free.any(axis=(0, 2)))
    used |= expansion.fixed_slope.any(axis=(0, 1)) | expansion.free_slope.any(axis=(0, 1, 3))
    fixed, free = expansion.fixed[:, used], expansion.free[:, used]
    return Expansion(fixed, free, expansion.fixed_slope[:, :, used], expansion.free_slope[:, :, used]), used


def _factors(structure: Structure, theta: Array, period_s: float, used: NDArray[np.bool_]) -> list[tuple[Array, Array]]:
    """Per output R (r, s) and target (r,) with |target - R w| = |y - S' w| for every w, over the rows that count.

    S holds the ``used`` signals.
    """
    segments = [(index, each.outputs) for index, each in enumerate(structure.segments) if each.period_s == period_s]
    tables = ((structure.signals(theta, index), targets) for index, targets in segments)
    outputs = len(segments[0][1])
    if all((np.isnan(targets) == np.isnan(targets[0])).all() for _, targets in segments):
        # one segment's signals at a time: those of all may not fit into memory
        R = _triangle(tables, used, outputs)
        return [(R[:, :-outputs], R[:, index - outputs]) for index in range(outputs)]
    kept = list(tables)
    alone = (_triangle([(each, rows[index, None]) for each, rows in kept], used, 1) for index in range(outputs))
    return [(R[:, :-1], R[:, -1]) for R in alone]


def _triangle(tables: Iterable[tuple[Array, Array]], used: NDArray[np.bool_], outputs: int) -> Array:
    """The R of a QR factorisation of used signals (s, N) and targets (q, N), transposed, over the samples that count.

    In blocks of samples that stay in the cache: a whole table at once takes twice as long.
    """
    triangles = []
    size = int(used.sum()) + outputs
    upper = np.tri(size, dtype=bool).T
    for signals, targets in tables:
        counts = ~np.isnan(targets[0])
        for start in range(0, len(counts), _BLOCK_SAMPLES):
            cut = slice(start, start + _BLOCK_SAMPLES)
            block = np.concatenate([signals[used, cut], targets[:, cut]])
            if not counts[cut].all():
                block = block[:, counts[cut]]
            if not block.shape[1]:
                continue
            # its transpose has the columns where LAPACK wants them: nothing is copied
            packed, _, _, _ = dgeqrf(block.T, overwrite_a=1)
            rows = min(packed.shape)
            triangles.append(packed[:rows] * upper[:rows])
    return np.asarray(np.linalg.qr(np.concatenate(triangles), mode="r"))
