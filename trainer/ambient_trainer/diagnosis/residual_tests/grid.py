"""Every test looks at the same uniform grid of means, few enough that a residual can be simulated hundreds of times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.record import bridged

Array = NDArray[np.float64]

MOST_SAMPLES = 1200


@dataclass(frozen=True)
class Grid:
    """``samples`` intervals of ``step_s`` from ``start_s`` on; ``index`` (N,) says in which each raw sample lies."""

    start_s: float
    step_s: float
    samples: int
    index: NDArray[np.intp]

    @staticmethod
    def over(time_s: Array) -> Grid:
        """The grid for increasing times (N,): their own period, or as coarse as ``MOST_SAMPLES`` makes it."""
        span, own = float(time_s[-1] - time_s[0]), float(np.median(np.diff(time_s)))
        step = max(own, span / (MOST_SAMPLES - 1))
        # the grid begins half a step early, so that each of evenly spaced samples lies in the middle of an interval
        index = np.floor((time_s - time_s[0]) / step + 0.5).astype(np.intp)
        return Grid(float(time_s[0]), step, int(index[-1]) + 1, index)

    @property
    def time_s(self) -> Array:
        """The middle of each interval, (n,)."""
        return np.asarray(self.start_s + self.step_s * np.arange(self.samples), dtype=np.float64)

    def means(self, values: Array) -> Array:
        """The mean of ``values`` (N,) over each interval, (n,); NaN where none is known."""
        known = np.isfinite(values)
        counts = np.bincount(self.index[known], minlength=self.samples)
        sums = np.bincount(self.index[known], weights=values[known], minlength=self.samples)
        return np.asarray(np.where(counts > 0, sums / np.maximum(counts, 1), np.nan), dtype=np.float64)

    def filled(self, values: Array) -> Array | None:
        """As :meth:`means`, with gaps bridged by straight lines; None where nothing is known."""
        means = self.means(values)
        return bridged(means) if np.isfinite(means).any() else None
