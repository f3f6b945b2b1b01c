"""A line of many samples is drawn from fewer, and no peak is lost: of every stretch the lowest and highest stay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array

_GAP_STEPS = 2.5


def extremes(values: Array, limit: int) -> NDArray[np.intp]:
    """The indices to draw of ``values`` (n,): at most ``limit`` + 2, ascending; all where n <= ``limit``.

    They are the first, the last, and of each of ``limit`` / 3 equal stretches the lowest, the highest and one missing
    value (NaN), so that gaps stay visible.
    """
    if len(values) <= limit:
        return np.arange(len(values))
    size = -(-len(values) // (limit // 3))
    padded = np.concatenate([values, np.full(-len(values) % size, values[-1])]).reshape(-1, size)
    missing = np.isnan(padded)
    picks = (
        np.where(missing, np.inf, padded).argmin(axis=1),
        np.where(missing, -np.inf, padded).argmax(axis=1),
        np.where(missing.any(axis=1), missing.argmax(axis=1), 0),
    )
    starts = np.arange(len(padded)) * size
    kept = np.concatenate([[0], *(starts + pick for pick in picks), [len(values) - 1]])
    return np.unique(np.minimum(kept, len(values) - 1)).astype(np.intp)


def envelope(low: Array, high: Array, limit: int) -> tuple[NDArray[np.intp], Array, Array]:
    """Where to draw a band of shape (n,), and its ends there: the widest of each of at most ``limit`` stretches.

    A stretch without any value gives NaN.
    """
    size = -(-len(low) // limit)
    starts = np.arange(0, len(low), size)
    return starts, np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def broken_at_gaps(x: Array, y: Array) -> tuple[Array, Array]:
    """The samples that have a value, with a NaN wherever more than two are missing in a row.

    A column logged every tenth row is so drawn as a line, and a sensor that was away for a while with a hole.
    """
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 2:
        return x, y
    steps = np.diff(x)
    after = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1
    return np.insert(x, after, x[after - 1]), np.insert(y, after, np.nan)
