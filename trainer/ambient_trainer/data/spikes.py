"""Spikes: a few readings that jump far away and return at once, as an error code does; the local median replaces them.

A Hampel filter (Pearson 2002, https://doi.org/10.1109/87.974338) whose limit grows with what the column does anyway.
"""

from __future__ import annotations

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
    """Replace isolated readings that no temperature can have taken.

    Parameters
    ----------
    trace : Trace
        Its columns that end in ``_degC`` are looked at.

    Returns
    -------
    trace : Trace
        With the local median instead of each spike.
    count : dict
        How many, by column; columns without any are left out.
    """
    columns, count = dict(trace.columns), {}
    for name in (each for each in columns if each.endswith("_degC")):
        row = pd.Series(columns[name])
        median = row.rolling(_AROUND, center=True, min_periods=_AROUND // 2).median()
        apart = (row - median).abs().to_numpy()
        if not np.isfinite(apart).any():
            continue
        low, high = np.nanquantile(row, [_MOST, 1.0 - _MOST])
        beyond = (row < low - (high - low)) | (row > high + (high - low)) | row.isin(SENTINELS_DEGC)
        spikes = beyond.to_numpy() & (apart > max(_LEAST_DEGC, _TIMES * float(np.nanquantile(apart, 1.0 - _MOST))))
        if spikes.any():
            columns[name] = np.where(spikes, median.to_numpy(), columns[name])
            count[name] = int(spikes.sum())
    return (replace(trace, columns=columns), count) if count else (trace, count)
