"""Robust tests: what the residual goes along with, against residuals that remember alike and go along with nothing.

The residual and what may drive it are both whitened by the residual's memory; their correlation is taken as a Student's
t. Hundreds of residuals are simulated with that memory and treated alike, memory refitted: that gives each subject the
t of its own chance, and all subjects together one factor on it, so that one of them fails by chance in 5 % of reports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.residual_tests.memory import past, remembered, simulated, whitening
from ambient_trainer.lti.lag import lagged

REPLICATES = 300
_OWN_LEVEL = 0.95
_DELAYS_STEPS = 0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0
_LONGEST_DELAY_FRAC = 0.25
_RATE_STEPS = 5
_EDGES = 25
"""Of the windows in which a level may be another one."""
_TURN_FRAC = 1 / 3
_NOTHING = 1e-150


@dataclass(frozen=True)
class Calibrated:
    """A series with ``REPLICATES`` simulated ones of its memory, to be treated alike: ``every`` (B + 1, n).

    The first row is the series itself, NaN where missing; ``filters`` (B + 1, p + 1) whiten each at ``rows`` (m,),
    where it is known with its past.
    """

    every: Array
    rows: NDArray[np.intp]
    filters: Array

    @staticmethod
    def of(series: Array, random: np.random.Generator) -> Calibrated | None:
        """``series`` (n,) calibrated; None where too little of it is known."""
        rows = remembered(series)
        if rows is None:
            return None
        every = np.concatenate([series[None], simulated(series, rows, REPLICATES, random)])
        return Calibrated(every, rows, whitening(every, rows))

    def without(self, courses: Array) -> Calibrated:
        """The same series, whitened by the memory that each has without the best of ``courses`` (d, n), which would
        pass for memory."""
        known = np.isfinite(self.every[0])
        centred = np.where(known, courses - courses[:, known].mean(axis=1, keepdims=True), 0.0)
        directions = centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), _NOTHING)
        along = np.nan_to_num(self.every) @ directions.T
        best = np.abs(along).argmax(axis=1)
        cleared = self.every - along[np.arange(len(along)), best][:, None] * directions[best]
        return replace(self, filters=whitening(cleared, self.rows))

    def along_with(self, courses: Array, given: Array | None = None) -> tuple[Array, int, float]:
        """|t| of each series (B + 1,) with that of ``courses`` (d, n) which is best, and of the series itself which
        that is, and how far it moves it over its range. The part of ``given`` (d, n) is taken out of both before."""
        innovations, size = self._innovations
        windows = past(courses, self.rows)
        norm = self._norm(windows)
        correlation = self._product(innovations, windows) / norm
        slopes = correlation[0] * size[0] / norm[0]
        if given is not None:
            others = past(given, self.rows)
            other = self._norm(others)
            first = self._product(innovations, others) / other
            shared = self._product(windows, others) / norm / other
            correlation = (correlation - first * shared) / np.sqrt(np.maximum((1 - first**2) * (1 - shared**2), 1e-12))
        free = max(1, len(self.rows) - self.filters.shape[1] - 1)
        t = np.abs(correlation) * np.sqrt(free / np.maximum(1 - correlation**2, 1e-12))
        best = int(t[0].argmax())
        return t.max(axis=1), best, float(slopes[best] * np.ptp(courses[best]))

    def change(self) -> tuple[Array, tuple[int, ...], float]:
        """How far apart the extremes of each series' cumulated innovations lie (B + 1,); of the series itself the
        samples at which its level changes, and by how much.

        The innovations' sum over the root of their number is the series' own over its long-run deviation.
        """
        cumulated = np.cumsum(self._innovations[0], axis=1)
        low, high = np.minimum(cumulated.min(axis=1), 0), np.maximum(cumulated.max(axis=1), 0)
        # an extreme that chance could have made is no turn
        extremes = (cumulated[0].argmin(), -low[0]), (cumulated[0].argmax(), high[0])
        turns = sorted(int(self.rows[at]) for at, depth in extremes if depth > _TURN_FRAC * (high - low)[0])
        return high - low, tuple(turns), _height(self.every[0], turns)

    @cached_property
    def _innovations(self) -> tuple[Array, Array]:
        """Of each series as a vector of length 1, (B + 1, m), and how long it was."""
        rows = np.einsum("bmi,bi->bm", past(self.every, self.rows), self.filters)
        size = np.linalg.norm(rows, axis=1)
        return rows / size[:, None], size

    def _product(self, one: Array, windows: Array) -> Array:
        """Of each series with each course, (B + 1, d), by the past of these (d, m, p + 1): the product of the
        innovations (B + 1, m), or of other courses, with what the series' filter makes of the course."""
        if one.ndim == 2:
            return np.asarray(np.einsum("bm,dmj,bj->bd", one, windows, self.filters, optimize=True))
        gram = one.transpose(0, 2, 1) @ windows
        return np.asarray(np.einsum("bi,dij,bj->bd", self.filters, gram, self.filters, optimize=True))

    def _norm(self, windows: Array) -> Array:
        return np.sqrt(np.maximum(self._product(windows, windows), _NOTHING))


def levels(samples: int) -> Array:
    """Windows in which a level may be another one, (d, n)."""
    at, edges = np.arange(samples), np.linspace(0, samples, _EDGES)
    return np.array([(start <= at) & (at < stop) for start, stop in combinations(edges, 2)], dtype=float)


def delayed(course: Array) -> tuple[Array, list[float]]:
    """What bodies that follow ``course`` (n,) with longer and longer delays make of it, (d, n), and these in steps."""
    delays = [each for each in _DELAYS_STEPS if each <= _LONGEST_DELAY_FRAC * len(course)]
    return np.stack([course, *(lagged(course, each, 1.0) for each in delays[1:])]), delays


def curved(course: Array) -> Array:
    """The square of ``course`` (n,), without what is straight in it."""
    centred = course - course.mean()
    return np.asarray(centred**2 - centred * (centred**2 @ centred) / (centred @ centred))


def rate(course: Array) -> Array:
    """Of ``course`` (n,), a step."""
    return np.asarray(np.gradient(uniform_filter1d(course, _RATE_STEPS, mode="nearest")))


def thresholds(by_chance: Sequence[Array], alpha: float) -> list[float]:
    """For each of the statistics by chance (B,), so that any is above its own in ``alpha`` of the reports."""
    if not by_chance:
        return []
    own = [float(np.quantile(each, _OWN_LEVEL)) for each in by_chance]
    worst = np.max([each / level for each, level in zip(by_chance, own)], axis=0)
    return [float(np.quantile(worst, 1 - alpha)) * level for level in own]


def _height(series: Array, turns: Sequence[int]) -> float:
    """How far the second level of ``series`` (n,) lies above the others; NaN where there is one only."""
    pieces = [piece[np.isfinite(piece)] for piece in np.split(series, [turn + 1 for turn in turns])]
    if len(pieces) < 2 or not all(len(piece) for piece in pieces):
        return float("nan")
    return float(pieces[1].mean() - np.concatenate([pieces[0], *pieces[2:]]).mean())
