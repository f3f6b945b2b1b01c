"""Robust tests: what the residual goes along with, against residuals that remember alike and go along with nothing.

The residual and what may drive it are both whitened by the residual's memory; their correlation is taken as a Student's
t. Hundreds of residuals are simulated with that memory and treated alike, memory refitted: that gives each subject the
t of its own chance, and all subjects together one factor on it, so that one of them fails by chance in 5 % of reports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.residual_tests.drivers import Driver
from ambient_trainer.diagnosis.residual_tests.noise import (
    autoregression_of,
    centred_past,
    filters_of,
    whitened,
)

Array = NDArray[np.float64]

REPLICATES = 300
_OWN_LEVEL = 0.99
_TURN_FRAC = 1 / 3


@dataclass(frozen=True)
class Dependence:
    """One subject's test before its threshold: the statistic, what chance made of it (B,), and what it says."""

    test: str
    sensor: str
    driver: str
    statistic: float
    by_chance: Array
    delay_steps: float
    size: float
    """How far the driver moves the residual over its range, in the residual's unit; of a change, its height."""
    turns: tuple[int, ...] = ()
    """Of a change: the samples at which it happens."""


@dataclass(frozen=True)
class Calibrated:
    """A series with ``REPLICATES`` simulated ones of its memory, to be treated alike: ``every`` (B + 1, n).

    The first row is the series itself, NaN where missing; ``filters`` (B + 1, order + 1) make of each its
    ``innovations`` (B + 1, m) at ``rows`` (m,), as a vector of length 1.
    """

    sensor: str
    every: Array
    filters: Array
    rows: NDArray[np.intp]
    innovations: Array

    @staticmethod
    def of(series: Array, sensor: str, random: np.random.Generator) -> Calibrated | None:
        """``series`` (n,) calibrated; None where too little of it is known."""
        memory = autoregression_of(series)
        if memory is None:
            return None
        every = np.concatenate([series[None], memory.simulated(REPLICATES, len(series), random)])
        filters = filters_of(every, memory.order, memory.rows)
        return Calibrated(sensor, every, filters, memory.rows, _directions(whitened(every, filters, memory.rows)))

    def along_with(self, driver: Driver) -> Dependence | None:
        """The test of ``driver``, at its best delay; None where it never changes while the series is known."""
        windows = self._past(driver.responses)
        energy = self._product(windows, windows)
        usable = (energy > 1e-20 * np.ptp(driver.responses) ** 2).all(axis=0)
        if not usable.any():
            return None
        norm = np.sqrt(np.maximum(energy, 1e-300))
        correlation = self._along(windows) / norm
        if driver.given is not None:
            correlation = self._without(driver.given, windows, norm, correlation)
        free = max(1, len(self.rows) - self.filters.shape[1] - 1)
        t = np.abs(_student(np.where(usable, correlation, 0.0), free))
        best = int(t[0].argmax())
        chosen = driver.responses[best]
        statistics, size = t.max(axis=1), self._slope(chosen) * float(np.ptp(chosen))
        return Dependence(
            driver.test, self.sensor, driver.name, float(statistics[0]), statistics[1:], driver.delays_steps[best], size
        )

    def drift(self, driver: Driver) -> Dependence | None:
        """As :meth:`along_with` for time itself. Its line would pass for memory: that is of what is left without it."""
        known = np.isfinite(self.every[0])
        course = np.where(known, driver.responses[0] - driver.responses[0, known].mean(), 0.0)
        slopes = np.nan_to_num(self.every) @ course / (course @ course)
        return self._remembering(self.every - slopes[:, None] * course).along_with(driver)

    def change(self, test: str) -> Dependence:
        """``test`` for a change of level: how far apart the extremes of the cumulated innovations lie.

        The innovations' sum over the root of their number is the series' own over its long-run deviation. The level's
        change would pass for memory: that is of what is left when the level may change twice.
        """
        cumulated = np.cumsum(self._remembering(self.every - _levels(self.every)).innovations, axis=1)
        low, high = np.minimum(cumulated.min(axis=1), 0), np.maximum(cumulated.max(axis=1), 0)
        statistics = high - low
        # an extreme that chance could have made is no turn
        turns = sorted(
            int(self.rows[at])
            for at, depth in ((cumulated[0].argmin(), -low[0]), (cumulated[0].argmax(), high[0]))
            if depth > _TURN_FRAC * statistics[0]
        )
        height = _height(self.every[0], turns)
        return Dependence(test, self.sensor, "", float(statistics[0]), statistics[1:], 0.0, height, tuple(turns))

    def _remembering(self, cleared: Array) -> Calibrated:
        """The same series, whitened by the memory of ``cleared`` (B + 1, n)."""
        filters = filters_of(cleared, self.filters.shape[1] - 1, self.rows)
        return replace(self, filters=filters, innovations=_directions(whitened(self.every, filters, self.rows)))

    def _past(self, courses: Array) -> Array:
        return centred_past(courses, self.filters.shape[1] - 1, self.rows)

    def _product(self, one: Array, other: Array) -> Array:
        """Of each series and delay: the product of two courses, whitened as the series, (B + 1, delays)."""
        gram = one.transpose(0, 2, 1) @ other
        return np.asarray(np.einsum("bi,kij,bj->bk", self.filters, gram, self.filters, optimize=True))

    def _along(self, windows: Array) -> Array:
        """The product of the innovations and a course, whitened as the series, (B + 1, delays)."""
        delays, rows, width = windows.shape
        products = self.innovations @ windows.transpose(1, 0, 2).reshape(rows, delays * width)
        return np.asarray(np.einsum("bki,bi->bk", products.reshape(-1, delays, width), self.filters))

    def _without(self, given: Array, windows: Array, norm: Array, correlation: Array) -> Array:
        """The partial correlation, with the part of ``given`` taken out of both."""
        others = self._past(given)
        energy = np.sqrt(np.maximum(self._product(others, others), 1e-300))
        first = self._along(others) / energy
        shared = self._product(windows, others) / norm / energy
        left = np.maximum((1 - first**2) * (1 - shared**2), 1e-12)
        return np.asarray((correlation - first * shared) / np.sqrt(left))

    def _slope(self, response: Array) -> float:
        """What the whitened series takes of the whitened ``response``."""
        windows = self._past(response[None])[0] @ self.filters[0]
        series = self._past(self.every[:1])[0] @ self.filters[0]
        return float(windows @ series / (windows @ windows))


def thresholds(found: Sequence[Dependence], alpha: float) -> list[float]:
    """For each of ``found``, so that by chance any of them is above its own in ``alpha`` of the reports."""
    if not found:
        return []
    own = [float(np.quantile(each.by_chance, _OWN_LEVEL)) for each in found]
    worst = np.max([each.by_chance / level for each, level in zip(found, own)], axis=0)
    factor = float(np.quantile(worst, 1 - alpha))
    return [factor * level for level in own]


def _directions(rows: Array) -> Array:
    """Each row as a vector of length 1."""
    return np.asarray(rows / np.sqrt((rows**2).sum(axis=1, keepdims=True)))


def _student(correlation: Array, free: int) -> Array:
    within = np.clip(correlation, -1 + 1e-12, 1 - 1e-12)
    return np.asarray(within * np.sqrt(free / (1 - within**2)))


def _levels(every: Array) -> Array:
    """Each series' mean before, between and after the two turns of its own cumulated sum, (B + 1, n)."""
    known = np.isfinite(every[0])
    filled = np.where(known, every, 0.0)
    centred = np.where(known, every - filled.sum(axis=1, keepdims=True) / known.sum(), 0.0)
    cumulated = np.cumsum(centred, axis=1)
    turns = np.sort([cumulated.argmin(axis=1), cumulated.argmax(axis=1)], axis=0)
    at = np.arange(every.shape[1])
    before, after = at <= turns[0][:, None], at > turns[1][:, None]
    levels = np.zeros_like(every)
    for piece in (before, ~before & ~after, after):
        inside = piece & known
        sums = (filled * inside).sum(axis=1, keepdims=True)
        levels += inside * sums / np.maximum(inside.sum(axis=1, keepdims=True), 1)
    return levels


def _height(series: Array, turns: Sequence[int]) -> float:
    """How far the second level of ``series`` (n,) lies above the others; NaN where there is one only."""
    pieces = [piece[np.isfinite(piece)] for piece in np.split(series, [turn + 1 for turn in turns])]
    if len(pieces) < 2 or not all(len(piece) for piece in pieces):
        return float("nan")
    return float(pieces[1].mean() - np.concatenate([pieces[0], *pieces[2:]]).mean())
