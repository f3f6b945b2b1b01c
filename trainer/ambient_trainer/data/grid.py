"""A trace becomes segments on a uniform grid, by the rule that the device follows (``ambient_model.tracking``).

A sample belongs to the grid point that its time rounds to. Missing inputs are drawn as straight lines between their
neighbours where the gap is short enough to be bridged; a longer one ends the segment. A missing output stays missing.
A fit may bridge longer ones, in which no output is compared: what follows a gap is no thermal equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_model.tracking import bridge_limit_s
from ambient_trainer.data.trace import Array, Trace

_SHORTEST = 3


@dataclass(frozen=True)
class Segment:
    """Uniform samples: inputs (m, N) without gaps, outputs (q, N) with NaN where there is nothing to compare with."""

    period_s: float
    inputs: Array
    outputs: Array

    def of(self, inputs: Sequence[int]) -> Segment:
        """The segment with the inputs of these indices."""
        return Segment(self.period_s, self.inputs[list(inputs)], self.outputs)

    def pieces(self, count: int) -> list[Segment]:
        """The segment cut into ``count`` of about equal length, or as many as leave three samples each."""
        count = max(1, min(count, self.inputs.shape[1] // _SHORTEST))
        cuts = zip(np.array_split(self.inputs, count, axis=1), np.array_split(self.outputs, count, axis=1))
        return [Segment(self.period_s, inputs, outputs) for inputs, outputs in cuts]


def sampling_period_s(time_s: Array) -> float:
    """The period a trace was logged with: the mean of the steps within half of the median one, to four digits.

    Rounded, because loggers mean 10 s when they write 9.993 and 10.04 in turn; kept as it is where the rounded one
    would drift by more than a quarter of a sample over the trace.
    """
    steps = np.diff(time_s)
    if not len(steps):
        return 1.0
    usual = steps[np.abs(steps - np.median(steps)) <= 0.5 * np.median(steps)]
    mean = float(np.mean(usual))
    rounded = float(f"{mean:.4g}")
    return rounded if abs(rounded - mean) * len(usual) <= 0.25 * mean else mean


def segments(
    trace: Trace, inputs: Sequence[str], outputs: Sequence[str], period_s: float | None = None, bridged_s: float = 0.0
) -> list[Segment]:
    """The uniform segments of ``trace`` with these columns; ``period_s`` defaults to the trace's own.

    Gaps of up to ``bridged_s`` end no segment; in one that the device does not bridge, outputs are missing.
    Raises :class:`Refused` where a column is missing or no stretch holds every input.
    """
    period = sampling_period_s(trace.time_s) if period_s is None else period_s
    u = np.vstack([trace.column(name) for name in inputs])
    y = np.vstack([trace.column(name) for name in outputs]) if outputs else np.empty((0, u.shape[1]))
    complete = np.flatnonzero(~np.isnan(u).any(axis=0))
    limit = round(bridge_limit_s(period) / period)
    longest = max(limit, round(bridged_s / period))
    found = []
    while len(complete):
        # the grid of a stretch starts at its own first sample, as on the device
        step = _steps(trace.time_s[complete], period)
        breaks = np.flatnonzero(np.diff(step) > longest)
        stop = breaks[0] + 1 if len(breaks) else len(complete)
        first, last = complete[0], complete[stop - 1]
        for gap in np.flatnonzero(np.diff(step[:stop]) > limit):
            y[:, complete[gap] + 1 : complete[gap + 1]] = np.nan
        stretch = slice(first, last + 1)
        if step[stop - 1] + 1 >= _SHORTEST:
            found.append(_laid_on_grid(trace.time_s[stretch], u[:, stretch], y[:, stretch], period))
        complete = complete[stop:]
    if not found:
        problem = f"no {_SHORTEST} samples in a row, one every {period:g} s, hold them all"
        hint = "leave out the column that is empty, or log again"
        raise refuse(trace.path, f"columns {', '.join(inputs)}", problem, hint)
    return found


def _steps(time_s: Array, period: float) -> NDArray[np.int_]:
    """The grid point of each sample, half a period rounding up as on the device."""
    return np.floor((time_s - time_s[0]) / period + 0.5).astype(int)


def _laid_on_grid(time_s: Array, u: Array, y: Array, period: float) -> Segment:
    step = _steps(time_s, period)
    grid = np.arange(step[-1] + 1)
    inputs = np.vstack([np.interp(grid, step[known], row[known]) for row in u for known in [~np.isnan(row)]])
    # np.interp keeps the first of two samples on one grid point, the device the last
    last = np.append(np.diff(step) > 0, True)
    inputs[:, step[last]] = np.where(np.isnan(u[:, last]), inputs[:, step[last]], u[:, last])
    outputs = np.full((y.shape[0], len(grid)), np.nan)
    outputs[:, step[last]] = y[:, last]
    return Segment(period, inputs, outputs)
