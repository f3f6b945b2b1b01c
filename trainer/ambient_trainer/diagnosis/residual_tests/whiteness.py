"""Is the residual white: does it forget itself from one sample to the next? Here a textbook threshold is right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ambient_trainer.diagnosis.result import Tested
from ambient_trainer.diagnosis.words import duration, share

Array = NDArray[np.float64]

MOST_LAGS = 20
_FORGOTTEN = 1 / np.e


def autocorrelation(series: Array, lags: int) -> tuple[Array, Array]:
    """At lags 0 to ``lags``, (lags + 1,): the correlation of ``series`` (n,) with itself, and of how many pairs."""
    known = np.isfinite(series)
    centred = np.where(known, series - series[known].mean(), 0.0)
    size = 2 ** int(np.ceil(np.log2(2 * len(series))))
    products = _with_itself(centred, size)[: lags + 1]
    pairs = np.rint(_with_itself(known.astype(float), size)[: lags + 1])
    means = products / np.maximum(pairs, 1)
    return means / means[0], pairs


def ljung_box(series: Array, sensor: str, alpha: float) -> Tested:
    """Ljung and Box: are the first correlations of ``series`` (n,) with itself together more than chance?"""
    lags = min(MOST_LAGS, int(np.isfinite(series).sum()) // 5)
    rho, pairs = autocorrelation(series, lags)
    statistic = float((pairs[1:] * rho[1:] ** 2).sum() * (pairs[0] + 2) / pairs[0])
    threshold = float(stats.chi2.isf(alpha, lags))
    significant = statistic > threshold
    said = (
        f"{sensor}: the residual is not white noise: its next value follows from its last ones."
        if significant
        else f"{sensor}: successive values of the residual have nothing to do with each other, as white noise."
    )
    return Tested("whiteness", sensor, statistic, threshold, significant, said)


def autocorrelation_time(series: Array, sensor: str, step_s: float) -> Tested:
    """How long until the correlation of ``series`` (n,) with itself has fallen to 1/e, in s; white noise: one step."""
    rho, pairs = autocorrelation(series, len(series) - 1)
    below = np.flatnonzero((rho < _FORGOTTEN) & (pairs > 0))
    if len(below):
        lag = int(below[0])
        remembered_s = step_s * (lag - (_FORGOTTEN - rho[lag]) / (rho[lag - 1] - rho[lag]))
    else:
        remembered_s = step_s * (len(series) - 1)
    significant = remembered_s > step_s
    said = (
        f"{sensor}: the residual remembers itself for about {duration(remembered_s)}: something slow is missing."
        if significant
        else f"{sensor}: the residual has forgotten itself after one sample of {duration(step_s)}."
    )
    return Tested("memory", sensor, float(remembered_s), step_s, significant, said)


def cumulated_periodogram(series: Array, sensor: str, step_s: float, alpha: float) -> Tested:
    """Bartlett: the largest distance of the cumulated periodogram of ``series`` (n,) from white noise's straight line.

    The threshold is Kolmogorov's.
    """
    known = np.isfinite(series)
    centred = np.where(known, series - series[known].mean(), 0.0)
    power = np.abs(np.fft.rfft(centred)[1:]) ** 2
    if len(series) % 2 == 0:
        power = power[:-1]  # the highest frequency of an even number has no phase, hence another distribution
    cumulated = np.cumsum(power)[:-1] / power.sum()
    count = len(cumulated)
    above = np.arange(1, count + 1) / count - cumulated
    below = cumulated - np.arange(count) / count
    statistic = float(max(above.max(), below.max()))
    threshold = float(stats.kstwo.isf(alpha, count))
    significant = statistic > threshold
    half = int(np.searchsorted(cumulated, 0.5)) + 1
    period = duration(len(series) * step_s / half)
    slow = below.max() > above.max()
    said = (
        f"{sensor}: half of the residual's power is in swings {'slower' if slow else 'faster'} than {period}; of white "
        f"noise {share(half / (count + 1))} would be."
        if significant
        else f"{sensor}: slow and fast swings share the residual's power evenly, as in white noise."
    )
    return Tested("periodogram", sensor, statistic, threshold, significant, said)


def _with_itself(values: Array, size: int) -> Array:
    return np.asarray(np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size))
