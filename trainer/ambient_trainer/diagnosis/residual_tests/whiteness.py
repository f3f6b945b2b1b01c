"""Whiteness tests of a residual: Ljung-Box, Bartlett's cumulated periodogram, and the autocorrelation time."""

import math

import numpy as np
from scipy import stats
from scipy.signal import correlate

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.result import Tested
from ambient_trainer.report.words import duration, share

MOST_LAGS = 20
_ONE_OVER_E = math.exp(-1)


def autocorrelation(series: Array) -> tuple[Array, Array]:
    """The autocorrelation of ``series`` (n,) at every lag, and the number of pairs at each."""
    known = np.isfinite(series)
    centred = np.where(known, series - series[known].mean(), 0.0)
    products, pairs = (correlate(row, row)[len(row) - 1 :] for row in (centred, known.astype(float)))
    means = products / np.maximum(np.rint(pairs), 1)
    return means / means[0], np.rint(pairs)


def ljung_box(series: Array, sensor: str, alpha: float) -> Tested:
    """The test of Ljung and Box (1978) on the first autocorrelations of ``series`` (n,)."""
    lags = min(MOST_LAGS, int(np.isfinite(series).sum()) // 5)
    rho, pairs = (row[: lags + 1] for row in autocorrelation(series))
    statistic = (pairs[1:] * rho[1:] ** 2).sum() * (pairs[0] + 2) / pairs[0]
    if_significant = "the residual is not white noise: its successive values are correlated"
    if_not = "successive values of the residual are not correlated, as in white noise"
    return Tested.of("whiteness", sensor, if_significant, if_not, statistic, stats.chi2.isf(alpha, lags))


def autocorrelation_time_s(series: Array, step_s: float) -> float:
    """The time until the autocorrelation of ``series`` (n,) is 1/e; white noise: one step."""
    rho, pairs = autocorrelation(series)
    below = np.flatnonzero((rho < _ONE_OVER_E) & (pairs > 0))
    if not len(below):
        return step_s * (len(series) - 1)
    lag = int(below[0])
    return float(step_s * (lag - (_ONE_OVER_E - rho[lag]) / (rho[lag - 1] - rho[lag])))


def autocorrelation_test(series: Array, sensor: str, step_s: float) -> Tested:
    """Whether the autocorrelation time of ``series`` (n,) is longer than a step."""
    time_s = autocorrelation_time_s(series, step_s)
    if_significant = f"the residual is autocorrelated over about {duration(time_s)}: something slow may be missing"
    if_not = f"the residual is not autocorrelated beyond one sample of {duration(step_s)}"
    return Tested.of("memory", sensor, if_significant, if_not, time_s, step_s)


def cumulated_periodogram(series: Array, sensor: str, step_s: float, alpha: float) -> Tested:
    """Bartlett: the largest distance of the cumulated periodogram of ``series`` (n,) from white noise's straight line.

    The threshold is Kolmogorov's.
    """
    known = np.isfinite(series)
    power = np.abs(np.fft.rfft(np.where(known, series - series[known].mean(), 0.0))[1:]) ** 2
    if len(series) % 2 == 0:
        power = power[:-1]  # the highest frequency of an even number has no phase, hence another distribution
    cumulated = np.cumsum(power)[:-1] / power.sum()
    found, threshold = stats.ks_1samp(cumulated, stats.uniform.cdf), stats.kstwo.isf(alpha, len(cumulated))
    half = int(np.searchsorted(cumulated, 0.5)) + 1
    periods = f"{'longer' if found.statistic_sign < 0 else 'shorter'} than {duration(len(series) * step_s / half)}"
    usual = share(half / (len(cumulated) + 1))
    if_significant = f"half of the residual's power is at periods {periods}; for white noise it is {usual}"
    if_not = "the residual's power is distributed evenly over all periods, as in white noise"
    return Tested.of("periodogram", sensor, if_significant, if_not, found.statistic, threshold)
