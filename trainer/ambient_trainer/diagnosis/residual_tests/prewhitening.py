"""Prewhitened cross-correlation tests of a series (Box and Jenkins; Haugh 1976; Ljung, ch. 16).

An autoregression, its order by Akaike's criterion, leaves innovations of the series; the same filter passes over what
it may follow, and their correlation is taken as a Student's t. A short series says little of its autocorrelation,
and one taken too short passes for an effect: it is taken as long as the series leaves probable.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import solve_triangular

from ambient_trainer.data.trace import Array

_FEWEST_LAGS, _MOST_LAGS, _FEWEST_ROWS = 3, 32, 30
_SURE = 2.0
"""Standard errors that the weights of the past may sum to more than least squares says."""
_SHORTEST_FRAC = 1 / 25
"""Of the series: no level that is another one lasts shorter."""
_HAIR, _NOTHING = 1e-10, 1e-150
"""Of the past: it keeps the equations of one that is all but constant from being singular; and what is no divisor."""


class Largest(NamedTuple):
    """The largest of ``trials`` Student's t, regardless of sign, of ``free`` degrees of freedom each."""

    t: float
    trials: int
    free: int

    def threshold(self, alpha: float) -> float:
        """What chance exceeds with a probability of at most ``alpha``: Bonferroni's."""
        return float(stats.t.isf(alpha / (2 * self.trials), self.free))


def testable(series: Array) -> bool:
    """Whether enough of ``series`` (n,) is known, each with its past, and changes there."""
    rows = _rows(series)
    return len(rows) >= _FEWEST_ROWS and bool(np.ptp(series[rows]) > 0)


def _rows(series: Array) -> NDArray[np.intp]:
    """Where ``series`` (n,) and all its past are known, (m,)."""
    unknown = np.convolve(~np.isfinite(series), np.ones(_MOST_LAGS + 1))[: len(series)]
    return np.flatnonzero((unknown < 0.5) & (np.arange(len(series)) >= _MOST_LAGS))


def _autoregression(series: Array) -> tuple[Array, Array, int]:
    """The past (m, lags) of ``series`` (n,), last value first, and its value, one array, less means; its R; the order.

    The squares that so many lags leave are those below them in the last column of R.
    """
    rows = _rows(series)
    lags = min(_MOST_LAGS, len(rows) // _FEWEST_LAGS)
    both = series[rows[:, None] - np.append(np.arange(1, lags + 1), 0)]
    both -= both.mean(axis=0)
    hair = (_HAIR * np.linalg.norm(both) + _NOTHING) * np.eye(lags, lags + 1)
    R = np.asarray(np.linalg.qr(np.concatenate([both, hair]), mode="r"))
    left = np.maximum(np.cumsum(R[::-1, -1] ** 2)[::-1], _NOTHING)
    akaike = len(rows) * np.log(left) + 2 * np.arange(lags + 1)
    return both, R, max(_FEWEST_LAGS, int(akaike.argmin()))


def whitening(series: Array) -> Array:
    """The filter (p + 1,) that leaves innovations of ``series`` (n,).

    Least squares make long memory too short, the sum of its weights by (1 + 3 sum) / m: that is put right, the sum
    taken at its upper confidence limit, and at most 1: what may be a random walk is differenced.
    """
    both, R, order = _autoregression(series)
    inner, samples = R[:order, :order], len(both)
    weights = solve_triangular(inner, R[:order, -1])
    sd = np.linalg.norm(R[order:, -1]) / np.sqrt(samples - order - 1)
    error = sd * np.linalg.norm(solve_triangular(inner, np.ones(order), trans="T"))
    total = weights.sum()
    weights[0] += min(1.0, total + (1 + 3 * total) / samples + _SURE * error) - total
    return np.append(1.0, -weights)


def correlated(series: Array, whiten: Array, courses: Array, *given: Array) -> tuple[Largest, int, float]:
    """Student's t of ``series`` (n,) with that of ``courses`` (d, n) which it follows best, which one that is, and how
    far it moves the series over its range; each course beside its own one of ``given`` (d, n)."""
    together = np.stack([*given, courses, np.broadcast_to(series, courses.shape)], axis=-1)
    whitened = sliding_window_view(together, len(whiten), axis=1) @ whiten[::-1]
    rows = whitened[:, np.isfinite(whitened[0, :, -1])]
    if whiten.sum() > _HAIR:
        # differences have no level
        rows = rows - rows.mean(axis=1, keepdims=True)
    R, samples = np.asarray(np.linalg.qr(rows, mode="r")), rows.shape[1]
    free, ranges = samples - len(whiten) - 1, np.ptp(courses, axis=1)
    moves = np.abs(R[:, -2, -2]) > _HAIR * np.sqrt(samples) * ranges
    t = np.where(moves, np.abs(R[:, -2, -1]) * np.sqrt(free) / np.maximum(np.abs(R[:, -1, -1]), _NOTHING), 0.0)
    best = int(t.argmax())
    size = R[best, -2, -1] / R[best, -2, -2] * ranges[best] if moves[best] else 0.0
    return Largest(float(t[best]), len(courses), free), best, float(size)


def shifted(series: Array) -> tuple[Largest, list[int]]:
    """Student's t of the stretch in which the innovations of ``series`` (n,) have another mean, and after which samples
    that begins and ends: the one of all stretches whose is largest (Quandt 1960), the past fitted beside each.

    One that both begins and ends within the series has to be better by Schwarz's criterion.
    """
    both, _, order = _autoregression(series)
    samples, free = len(both), len(both) - order - 2
    Q = np.insert(np.linalg.qr(both[:, :order])[0], 0, 1 / np.sqrt(samples), axis=1)
    innovations = both[:, -1] - Q @ (Q.T @ both[:, -1])
    # sums over all stretches, from each edge to each other one
    past, total = (np.cumsum(np.insert(each, 0, 0.0, axis=0), axis=0) for each in (Q, innovations))
    edges, shared = np.arange(samples + 1), past @ past.T
    lasts, shortest = edges - edges[:, None], max(_FEWEST_LAGS, int(_SHORTEST_FRAC * samples))
    offered = (lasts >= shortest) & (lasts <= samples - shortest)
    # what the past leaves of a stretch's own square
    own = lasts - (np.diag(shared) + np.diag(shared)[:, None] - 2 * shared)
    gain = np.where(offered, (total - total[:, None]) ** 2 / np.where(own > _HAIR * samples, own, np.inf), 0.0)
    square = gain * free / np.maximum(innovations @ innovations - gain, _NOTHING)
    within = (edges[:, None] > 0) & (edges < samples)
    score = np.where(offered, square - 2 * np.log(samples) * within, -np.inf)
    best = np.unravel_index(score.argmax(), score.shape)
    turns = [int(_rows(series)[edge]) - 1 for edge in best if 0 < edge < samples]
    return Largest(float(np.sqrt(square[best])), int(offered.sum()), free), turns
