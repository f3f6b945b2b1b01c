"""Tests whether a residual is white, with textbook thresholds: Ljung-Box, Bartlett, and the autocorrelation time."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ambient_trainer.diagnosis.result import Tested
from ambient_trainer.diagnosis.words import duration, share

Array = NDArray[np.float64]

MOST_LAGS = 20
_ONE_OVER_E = math.exp(-1)


def autocorrelation(series: Array, lags: int) -> tuple[Array, Array]:
    """The autocorrelation of ``series`` (n,) at lags 0 to ``lags``, (lags + 1,), and the number of pairs at each."""
    known = np.isfinite(series)
    centred = np.where(known, series - series[known].mean(), 0.0)
    size = 2 ** int(np.ceil(np.log2(2 * len(series))))
    products = _with_itself(centred, size)[: lags + 1]
    pairs = np.rint(_with_itself(known.astype(float), size)[: lags + 1])
    means = products / np.maximum(pairs, 1)
    return means / means[0], pairs


def ljung_box(series: Array, sensor: str, alpha: float) -> Tested:
    """The test of Ljung and Box (1978) on the first autocorrelations of ``series`` (n,)."""
    lags = min(MOST_LAGS, int(np.isfinite(series).sum()) // 5)
    rho, pairs = autocorrelation(series, lags)
    statistic = float((pairs[1:] * rho[1:] ** 2).sum() * (pairs[0] + 2) / pairs[0])
    threshold = float(stats.chi2.isf(alpha, lags))
    significant = statistic > threshold
    sentence = (
        f"{sensor}: the residual is not white noise: its successive values are correlated."
        if significant
        else f"{sensor}: successive values of the residual are not correlated, as in white noise."
    )
    return Tested("whiteness", sensor, statistic, threshold, significant, sentence)


def autocorrelation_time(series: Array, sensor: str, step_s: float) -> Tested:
    """The time until the autocorrelation of ``series`` (n,) is 1/e, in s; white noise: one step."""
    rho, pairs = autocorrelation(series, len(series) - 1)
    below = np.flatnonzero((rho < _ONE_OVER_E) & (pairs > 0))
    if len(below):
        lag = int(below[0])
        time_s = step_s * (lag - (_ONE_OVER_E - rho[lag]) / (rho[lag - 1] - rho[lag]))
    else:
        time_s = step_s * (len(series) - 1)
    significant = time_s > step_s
    sentence = (
        f"{sensor}: the residual is autocorrelated over about {duration(time_s)}: something slow is missing."
        if significant
        else f"{sensor}: the residual is not autocorrelated beyond one sample of {duration(step_s)}."
    )
    return Tested("memory", sensor, float(time_s), step_s, significant, sentence)


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
    sentence = (
        f"{sensor}: half of the residual's power is in swings {'slower' if slow else 'faster'} than {period}; of white "
        f"noise {share(half / (count + 1))} would be."
        if significant
        else f"{sensor}: slow and fast swings share the residual's power evenly, as in white noise."
    )
    return Tested("periodogram", sensor, statistic, threshold, significant, sentence)


def _with_itself(values: Array, size: int) -> Array:
    return np.asarray(np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size))
