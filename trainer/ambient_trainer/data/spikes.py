"""Spikes: a few readings that jump far away and return at once, as an error code does; the local median replaces them.

A Hampel filter (Pearson 2002, https://doi.org/10.1109/87.974338) whose limit grows with what the column does anyway.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from ambient_model.validation import SENTINELS_DEGC
from ambient_trainer.data.trace import Trace

_AROUND, _MOST = 7, 0.02
"""Samples that a local median is of, and the share of readings that may be spikes."""
_LEAST_DEGC, _TIMES = 10.0, 10.0
"""A reading is one further from it than both, the latter in deviations that all but such a share stay within, and a
whole range beyond where the column is, or what sensors report instead of a value."""


def without_spikes(trace: Trace) -> tuple[Trace, dict[str, int]]:
    """The trace with the local median in the place of each spike, and how many of them by column, where there are any.

    Columns that end in ``_degC`` are held against what a temperature does, others against their own size.
    """
    columns, count = dict(trace.columns), {}
    for name, values in columns.items():
        row = pd.Series(values)
        median = row.rolling(_AROUND, center=True, min_periods=_AROUND // 2).median()
        apart = (row - median).abs()
        if name.endswith("_degC"):
            low, high = row.quantile(_MOST), row.quantile(1.0 - _MOST)
            beyond = (row < low - (high - low)) | (row > high + (high - low)) | row.isin(SENTINELS_DEGC)
            spikes = beyond & (apart > max(_LEAST_DEGC, _TIMES * apart.quantile(1.0 - _MOST)))
        else:  # ten times as large as the column is; one that is rarely anything has no size
            size = row.abs().quantile(1.0 - _MOST)
            spikes = (apart > _TIMES * size) & (size > 0)
        if spikes.any():
            columns[name] = np.where(spikes.to_numpy(), median.to_numpy(), values)
            count[name] = int(spikes.sum())
    return (replace(trace, columns=columns), count) if count else (trace, count)
