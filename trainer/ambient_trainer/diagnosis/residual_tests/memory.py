"""The memory of a series: its next value from its past, and an innovation that nothing predicts.

White noise on top of something slow needs a long past. Long but few: the past is its last value, the one before, and
the means of the 2, 4, 8 and 16 before those.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array

PAST = ((1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 32))
"""The stretches of the past, first and last lag of each."""
_LAGS = PAST[-1][1]
_FEWEST_ROWS = 30
_DRAWN, _WIDER = 100, 2.0
"""So many memories for all simulated series; and how much further they scatter than least squares says, whose weights
miss memories as long as the series."""
_HAIR = 1e-10
"""Of a series' variance: it keeps the normal equations of one that is all but constant from being singular."""


def remembered(series: Array) -> NDArray[np.intp] | None:
    """Where ``series`` (n,) and all its past are known; None where that is too little, or nothing changes there."""
    unknown = np.convolve(~np.isfinite(series), np.ones(_LAGS + 1))[: len(series)]
    rows = np.flatnonzero((unknown < 0.5) & (np.arange(len(series)) >= _LAGS))
    return rows if len(rows) >= _FEWEST_ROWS and np.ptp(series[rows]) > 0 else None


def past(series: Array, rows: NDArray[np.intp]) -> Array:
    """Of each of (B, n), at each of ``rows``: its value, then the stretches of its past, (B, m, p + 1), less means."""
    known = np.nan_to_num(series)
    summed = np.cumsum(np.pad(known, ((0, 0), (1, 0))), axis=1)
    means = ((summed[:, rows - first + 1] - summed[:, rows - last]) / (last - first + 1) for first, last in PAST)
    windows = np.stack([known[:, rows], *means], axis=2)
    return np.asarray(windows - windows.mean(axis=1, keepdims=True))


def whitening(series: Array, rows: NDArray[np.intp]) -> Array:
    """The weights (B, p + 1) on the :func:`past` that whiten each series of (B, n), by least squares."""
    inner, across = _normal(past(series, rows))
    return np.insert(-np.linalg.solve(inner, across)[:, :, 0], 0, 1.0, axis=1)


def _normal(windows: Array) -> tuple[Array, Array]:
    """The normal equations (B, p, p) and (B, p, 1) of a :func:`past`."""
    gram = windows.transpose(0, 2, 1) @ windows
    return gram[:, 1:, 1:] + _HAIR * gram[:, :1, :1] * np.eye(len(PAST)), gram[:, 1:, :1]


def simulated(series: Array, rows: NDArray[np.intp], count: int, random: np.random.Generator) -> Array:
    """``count`` series (count, n) of unit innovations that may remember as ``series`` (n,) does, and hold nothing else.

    A short series says little of how slow it is, and held to one memory whatever is slow in it would pass for an
    effect: the simulated ones have memories drawn from all that it leaves probable.
    """
    windows, filters = past(series[None], rows), whitening(series[None], rows)[0]
    variance = np.sum((windows[0] @ filters) ** 2) / (len(rows) - len(PAST) - 1)
    covariance = _WIDER**2 * variance * np.linalg.inv(_normal(windows)[0][0])
    drawn = random.multivariate_normal(-filters[1:], covariance, _DRAWN, "ignore", method="eigh")
    innovations = np.array_split(random.standard_normal((count, 2 * len(series))), _DRAWN)
    spans = np.array([last - first + 1 for first, last in PAST])
    weights = _unbiased(np.repeat(drawn / spans, spans, axis=1), len(rows), len(series))
    result = [lfilter([1.0], [1.0, *-each], some, axis=1) for each, some in zip(weights, innovations)]
    return np.concatenate(result)[:, len(series) :]


def _unbiased(weights: Array, rows: int, samples: int) -> Array:
    """``weights`` of each lag (d, lags): stable, for so many ``samples``.

    The least squares of a series with a long memory make it too short, their sum by (1 + 3 sum) / ``rows``: that is put
    right first.
    """
    weights[:, 0] += np.maximum(0.0, 1 + 3 * weights.sum(axis=1)) / rows
    companions = np.tile(np.eye(_LAGS, k=-1), (len(weights), 1, 1))
    companions[:, 0] = weights
    slowest = np.abs(np.linalg.eigvals(companions)).max(axis=1, keepdims=True)
    shrink = np.minimum(1.0, (1 - 1 / samples) / np.maximum(slowest, 1e-300))
    return np.asarray(weights * shrink ** np.arange(1, _LAGS + 1))
