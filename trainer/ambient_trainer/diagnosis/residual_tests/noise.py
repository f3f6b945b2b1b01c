"""Autoregressive noise: a series' next value from its past, and an innovation that nothing predicts.

White noise on top of something slow needs a long past. Long but few: the past is its last value, the one before, and
the means of the 2, 4, 8 and 16 before those; Akaike's criterion takes the first ``order`` of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array

PAST = ((1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 32))
"""The stretches of the past, first and last lag of each."""
_FEWEST_ROWS = 30
_DRAWN = 100
"""So many memories for all simulated series."""
_CHUNK = 50
_HAIR = 1e-10
"""What keeps the normal equations of a series that is all but constant from being singular."""


@dataclass(frozen=True)
class OrderFit:
    """The ``weights`` (p,) of all p stretches of :data:`PAST`, zero beyond an order, from ``rows`` samples.

    What they leave open is ``deviations`` (p, p) times standard normal numbers.
    """

    weights: Array
    deviations: Array
    rows: int


@dataclass(frozen=True)
class Autoregression:
    """x[k] = c + sum_j weights[j] mean(x[k - PAST[j]]) + innovation; ``rows`` (m,) are the k with all that known.

    ``fits`` are those of every order, ``shares`` (p + 1,) how likely each makes the series.
    """

    weights: Array
    rows: NDArray[np.intp]
    fits: tuple[OrderFit, ...]
    shares: Array

    @property
    def order(self) -> int:
        """How many stretches of the past have a weight."""
        return len(self.weights)

    def simulated(self, count: int, samples: int, random: np.random.Generator) -> Array:
        """``count`` series (count, samples) of unit innovations that may remember so, and hold nothing else.

        A short series says little of how slow it is, and held to one memory whatever is slow in it would pass for an
        effect: the simulated ones have memories drawn from all that it leaves probable.
        """
        chosen = [self.fits[order] for order in random.choice(len(self.fits), _DRAWN, p=self.shares)]
        drawn = np.array([fit.weights + fit.deviations @ random.standard_normal(len(PAST)) for fit in chosen])
        lags = _unbiased(drawn, np.array([fit.rows for fit in chosen]), samples)
        innovations = np.array_split(random.standard_normal((count, 2 * samples)), _DRAWN)
        series = [lfilter([1.0], np.concatenate([[1.0], -each]), some, axis=1) for each, some in zip(lags, innovations)]
        return np.concatenate(series)[:, samples:]


def _unbiased(drawn: Array, rows: NDArray[np.intp], samples: int) -> Array:
    """The weight of each single lag by each of ``drawn`` (d, p), (d, lags): stable, for so many ``samples``.

    The least squares of a series with a long memory make it too short, their sum by (1 + 3 sum) / ``rows`` (d,): that
    is put right first.
    """
    spans = np.array([last - first + 1 for first, last in PAST])
    weights = np.repeat(drawn / spans, spans, axis=1)
    weights[:, 0] += np.where(drawn.any(axis=1), np.maximum(0.0, 1 + 3 * weights.sum(axis=1)) / rows, 0.0)
    count = weights.shape[1]
    companions = np.tile(np.eye(count, k=-1), (len(weights), 1, 1))
    companions[:, 0] = weights
    slowest = np.abs(np.linalg.eigvals(companions)).max(axis=1, keepdims=True)
    shrink = np.minimum(1.0, (1 - 1 / samples) / np.maximum(slowest, 1e-300))
    return np.asarray(weights * shrink ** np.arange(1, count + 1))


def autoregression_of(series: Array) -> Autoregression | None:
    """The memory of ``series`` (n,), of the order that Akaike's criterion takes; None where too little is known.

    NaN is a missing value.
    """
    common = _rows(series, len(PAST))
    if len(common) < _FEWEST_ROWS or np.ptp(series[common]) == 0.0:
        return None
    windows = centred_past(series[None], len(PAST), common)[0]
    gram = windows.T @ windows
    left = np.array([max(_left(gram, order), 1e-300) for order in range(len(PAST) + 1)])
    order = int(np.argmin(len(common) * np.log(left) + 2 * np.arange(len(left))))
    likelihood = np.exp(-0.5 * len(common) * np.log(left / left.min()))
    fits = tuple(_fit(series, each) for each in range(len(left)))
    return Autoregression(fits[order].weights[:order], _rows(series, order), fits, likelihood / likelihood.sum())


def _fit(series: Array, order: int) -> OrderFit:
    rows = _rows(series, order)
    weights, deviations = np.zeros(len(PAST)), np.zeros((len(PAST), len(PAST)))
    if order:
        windows = centred_past(series[None], order, rows)[0]
        filters = filters_of(series[None], order, rows)[0]
        squares, directions = np.linalg.eigh(windows[:, 1:].T @ windows[:, 1:])
        innovation = np.linalg.norm(windows @ filters) / np.sqrt(len(rows) - order - 1)
        weights[:order] = -filters[1:]
        deviations[:order, :order] = innovation * directions / np.sqrt(np.maximum(squares, _HAIR * squares.max()))
    return OrderFit(weights, deviations, len(rows))


def filters_of(series: Array, order: int, rows: NDArray[np.intp]) -> Array:
    """The weights (B, order + 1) on :func:`past` that whiten each series of (B, n), by least squares."""
    filters = np.ones((len(series), order + 1))
    for part in _chunks(series) if order else ():
        windows = centred_past(series[part], order, rows)
        gram = windows.transpose(0, 2, 1) @ windows
        gram[:, range(1, order + 1), range(1, order + 1)] *= 1 + _HAIR
        filters[part, 1:] = -np.linalg.solve(gram[:, 1:, 1:], gram[:, 1:, :1])[:, :, 0]
    return filters


def whitened(series: Array, filters: Array, rows: NDArray[np.intp]) -> Array:
    """The innovations (B, m) that ``filters`` (B, order + 1) make of each series of (B, n), of mean 0."""
    found = np.empty((len(series), len(rows)))
    for part in _chunks(series):
        windows = centred_past(series[part], filters.shape[1] - 1, rows)
        found[part] = (windows @ filters[part, :, None])[:, :, 0]
    return found


def centred_past(series: Array, order: int, rows: NDArray[np.intp]) -> Array:
    """As :func:`past`, less the mean over the rows."""
    windows = past(series, order, rows)
    windows -= windows.mean(axis=1, keepdims=True)
    return windows


def past(series: Array, order: int, rows: NDArray[np.intp]) -> Array:
    """Of each of (B, n), at each of ``rows``: its value, then ``order`` stretches of its past, (B, m, order + 1)."""
    found = np.empty((len(series), len(rows), order + 1))
    found[:, :, 0] = series[:, rows]
    summed = np.cumsum(np.concatenate([np.zeros((len(series), 1)), np.nan_to_num(series)], axis=1), axis=1)
    for column, (first, last) in enumerate(PAST[:order], start=1):
        found[:, :, column] = (summed[:, rows - first + 1] - summed[:, rows - last]) / (last - first + 1)
    return found


def _chunks(series: Array) -> Iterator[slice]:
    return (slice(start, start + _CHUNK) for start in range(0, len(series), _CHUNK))


def _rows(series: Array, order: int) -> NDArray[np.intp]:
    """Where ``series`` (n,) and all its past of ``order`` stretches are known."""
    longest = PAST[order - 1][1] if order else 0
    if len(series) <= longest:
        return np.empty(0, dtype=np.intp)
    unknown = np.cumsum(np.concatenate([[0], ~np.isfinite(series)]))
    return np.asarray(np.flatnonzero(unknown[longest + 1 :] == unknown[: -longest - 1]) + longest)


def _left(gram: Array, order: int) -> float:
    """The squares that ``order`` stretches of the past leave."""
    if not order:
        return float(gram[0, 0])
    inner = gram[1 : order + 1, 1 : order + 1]
    inner = inner + _HAIR * np.diag(np.diag(inner))
    return float(gram[0, 0] - gram[0, 1 : order + 1] @ np.linalg.solve(inner, gram[1 : order + 1, 0]))
