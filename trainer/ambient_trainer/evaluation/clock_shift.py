"""Estimation of the shift between the clocks of two loggers from what their columns share.

A column that both have under one name is the same curve read twice: y(t) = c + g x(t - s). Where they have none, a
column of one drives one of the other through first-order lags, y = c + g L(x)(t - s). A body that is more than its lags
looks like a later clock: the interval then holds what one lag says and what two say, and where they disagree the shift
is not determined.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from scipy.stats import t as student

from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.estimation.uncertainty import autocorrelation_time
from ambient_trainer.lti.lag import lagged

_MOST_SAMPLES = 50_000
"""Of the coarse search."""
_LEAST_EXPLAINED = {"same": 0.5, "related": 0.95}
"""Of the variance of a column, by one quantity read twice and by what drives it; below, the match may be chance. Of the
measured sets, a cell's temperature follows the current of other pulses than its own to 0.88."""
_LONGEST_LAG = 0.05
"""Of a log: two random walks of 12 h follow each other to 0.97 by lags of hours."""
_NO_LAG = 0.05
"""Of the lags between two columns: no body is exactly its lags. On measured sets the shift is off by 0.02 and 0.03."""
_AS_GOOD = 9.2
"""Twice the log-likelihood by which a rival may fall behind: the 99 % quantile of chi-square with two degrees."""
_FEWEST = 60
"""Samples in common."""
_BLOCKS = 20
"""Of time, taken for independent: the clusters of the sandwich variance."""
_LAGS = np.array([1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
"""In samples, where the search for a lag starts."""
_SAME_GAIN = 1.5
_DRAWN = 0.02
"""Of the shorter period: by how much straight lines between samples move the best shift."""
_WIDTHS = 2.0 ** np.arange(0, 9)
"""In samples: standard deviations of the Gaussian by which both columns are smoothed."""
_CLEAR = 0.95
"""Correlation of the slopes of both columns: with less, noise passes for information on the shift."""
_GAP = 10.0
"""In periods: nothing is read within a longer step."""


@dataclass(frozen=True)
class ClockShift:
    """What to add to the other trace's time, with the 95 % interval.

    ``columns`` are the reference's and the other's, ``lags_s`` the lags between them, none for one quantity read
    twice; ``explained`` is the share of variance. ``problem`` says why the shift is not determined, if it is not.
    """

    shift_s: float
    ci95_s: tuple[float, float]
    columns: tuple[str, str]
    lags_s: tuple[float, ...] = ()
    explained: float = 0.0
    problem: str | None = None

    @property
    def significant(self) -> bool:
        """Whether it is determined and its interval excludes 0."""
        return self.problem is None and not self.ci95_s[0] <= 0.0 <= self.ci95_s[1]


@dataclass(frozen=True)
class _Series:
    """A column without its missing samples; ``sign`` is 1 on the first clock, on which the shift counts, or else -1."""

    name: str
    time_s: Array
    values: Array
    period_s: float
    sign: float

    @property
    def span_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])

    def at(self, time_s: Array, lags_s: Sequence[float] = ()) -> Array:
        """Its values at any times, after lags; NaN outside and within gaps."""
        times, values = self.time_s, self.values
        if lags_s:
            times = np.arange(times[0], times[-1] + self.period_s / 2, self.period_s)
            values = np.interp(times, self.time_s, self.values)
            for lag_s in lags_s:
                values = lagged(values, lag_s, self.period_s)
        next_ = np.searchsorted(self.time_s, time_s).clip(1, len(self.time_s) - 1)
        wide = self.time_s[next_] - self.time_s[next_ - 1] > _GAP * self.period_s
        return np.where(wide, np.nan, np.interp(time_s, times, values, np.nan, np.nan))

    def smooth(self, width_s: float) -> _Series:
        """It on a uniform grid, averaged with a Gaussian."""
        times = np.arange(self.time_s[0], self.time_s[-1] + self.period_s / 2, self.period_s)
        known = ~np.isnan(self.at(times))
        averaged = gaussian_filter1d(np.interp(times, self.time_s, self.values), width_s / self.period_s)
        return replace(self, time_s=times[known], values=averaged[known])


@dataclass(frozen=True)
class _Match:
    """The coarse shift of the driver ``x`` that fits ``y`` best; times the sign of ``y`` it is the other trace's."""

    y: _Series
    x: _Series
    lags_s: tuple[float, ...]
    shift_s: float
    explained: float
    problem: str | None

    @property
    def period_s(self) -> float:
        return max(self.y.period_s, self.x.period_s)


def clock_shift(reference: Trace, other: Trace, within_s: float | None = None) -> ClockShift | None:
    """Shift of the clock of ``other`` against that of ``reference``, of at most ``within_s``.

    By default it is any that leaves half of the shorter trace in common. None where no two columns change and have 60
    samples in common.

    A coarse search takes the correlation at every shift of a grid, the fine one least squares over shift and lags. The
    variance is the sandwich with blocks of time as clusters, and that of a stamp that was rounded to a sample is added.
    """
    ours, theirs = _series(reference, 1.0), _series(other, -1.0)
    both = [name for name in ours if name in theirs]
    tries: list[tuple[_Series, _Series, tuple[float, ...]]] = [(ours[name], theirs[name], ()) for name in both]
    if not both:
        tries = [
            (y, x, (lag_s,))
            for driven, driving in ((ours, theirs), (theirs, ours))
            for y in driven.values()
            if y.name.endswith("_degC")
            for x in _drivers(driving.values())
            for lag_s in (_LAGS * max(y.period_s, x.period_s)).tolist()
            if lag_s < _LONGEST_LAG * y.span_s
        ]
    found = [match for each in tries if (match := _matched(*each, within_s)) is not None]
    if not found:
        return None
    match = max(found, key=lambda each: each.explained)
    return _estimated(_smoothed(match) if both else match)


def _series(trace: Trace, sign: float) -> dict[str, _Series]:
    found = {}
    for name, values in trace.columns.items():
        known = ~np.isnan(values)
        if known.sum() > 2 and np.ptp(values[known]) > 0:
            period_s = sampling_period_s(trace.time_s[known])
            found[name] = _Series(name, trace.time_s[known], values[known], period_s, sign)
    return found


def _drivers(series: Iterable[_Series]) -> Iterator[_Series]:
    """What may drive a column: every column, and the square of what is no temperature."""
    for each in series:
        yield each
        if not each.name.endswith("_degC"):
            yield replace(each, name=f"{each.name}^2", values=each.values**2)


def _estimated(match: _Match) -> ClockShift:
    """The shift; with lags by one and by two of them: the better one, with the interval of both."""
    lags_s = match.lags_s
    results = [_refined(match, each) for each in ((lags_s, (*lags_s, lags_s[0] / 4)) if lags_s else ((),))]
    if lags_s and min(results[1].lags_s) < match.period_s:
        del results[1]  # a lag shorter than a sample is none
    best = max(results, key=lambda each: each.explained)
    low, high = min(each.ci95_s[0] for each in results), max(each.ci95_s[1] for each in results)
    problem, lag_s = best.problem, sum(best.lags_s)
    if problem is None and lags_s:
        wide = f"it lies between {low:.4g} and {high:.4g} s, wider than the lag between them"
        problems = {
            "what one does to the other differs between the first and the last half": not _steady(match, best),
            f"a lag of {lag_s:.4g} s between them needs a longer log": lag_s > _LONGEST_LAG * match.y.span_s,
            wide: high - low > max(lag_s, 5 * match.period_s),
        }
        problem = next((text for text, is_so in problems.items() if is_so), None)
    return replace(best, ci95_s=(low, high), problem=problem)


def _steady(match: _Match, shift: ClockShift) -> bool:
    """Whether the gain is the same in both halves: two columns that merely wander follow each other for a while."""
    y = match.y
    driven = match.x.at(y.time_s - y.sign * shift.shift_s, shift.lags_s)
    gains = []
    for part in np.array_split(np.flatnonzero(~np.isnan(driven)), 2):
        x, values = driven[part] - driven[part].mean(), y.values[part] - y.values[part].mean()
        gains.append(float(x @ values) / max(float(x @ x), 1e-12))
    return bool(min(gains) * max(gains) > 0 and 1 / _SAME_GAIN < gains[0] / gains[1] < _SAME_GAIN)


def _matched(y: _Series, x: _Series, lags_s: tuple[float, ...], within_s: float | None) -> _Match | None:
    """The best coarse shift of ``x`` on ``y``, and whether another fits as well."""
    period_s = max(y.period_s, x.period_s, max(y.span_s, x.span_s) / _MOST_SAMPLES)
    on_y, on_x = (np.arange(each.time_s[0], each.time_s[-1] + period_s / 2, period_s) for each in (y, x))
    correlation, lags, common = _correlation(y.at(on_y), x.at(on_x, lags_s))
    shifts_s = on_y[0] - on_x[0] + lags * period_s
    allowed = common >= max(0.5 * min(common.max(), len(on_y), len(on_x)), _FEWEST)
    allowed &= (np.abs(shifts_s) <= within_s) if within_s is not None else True
    if not allowed.any():
        return None
    # one quantity read twice rises and falls together
    explained = np.where(allowed, np.maximum(correlation, 0.0) ** 2 if not lags_s else correlation**2, 0.0)
    best = int(explained.argmax())
    shift_s = float(shifts_s[best])
    # what else fits as well: by as many independent samples as the residual there has
    left = np.maximum(1 - explained, 1e-6)
    values, driver = y.at(on_y), x.at(on_y - shift_s, lags_s)
    both = ~np.isnan(values + driver)
    residual = _projected(values[both], driver[both])
    behind = len(residual) / autocorrelation_time(residual) * np.log(left / left[best])
    peaks = [each for each in signal.find_peaks(-behind)[0] if behind[each] < _AS_GOOD and each != best]
    # the nearest first; there is a valley between them and the best
    apart = [each for each in peaks if behind[min(each, best) : max(each, best)].max() > _AS_GOOD]
    rivals = sorted(apart, key=lambda each: abs(each - best))
    others = ", ".join(f"{y.sign * shifts_s[each]:.4g} s" for each in rivals[:3])
    problem = f"{others} fits as well: narrow it by --within" if rivals else None
    return _Match(y, x, lags_s, shift_s, float(explained[best]), problem)


def _smoothed(match: _Match) -> _Match:
    """The match of columns that are smooth enough for their slopes to be alike."""
    period_s, best, clearest = match.period_s, match, -1.0
    for width_s in _WIDTHS * period_s:
        y, x = match.y.smooth(width_s), match.x.smooth(width_s)
        time_s = y.time_s[0] + period_s * np.arange(y.span_s / period_s)
        slopes = np.diff([y.at(time_s), x.at(time_s - match.shift_s, match.lags_s)])
        slopes = slopes[:, ~np.isnan(slopes).any(axis=0)]
        if slopes.shape[1] < _BLOCKS or not slopes.std(axis=1).all():
            break
        alike = abs(float(np.corrcoef(slopes)[0, 1]))
        if alike > clearest:
            best, clearest = replace(match, y=y, x=x), alike
        if alike > _CLEAR:
            break
    return best


def _correlation(y: Array, x: Array) -> tuple[Array, Array, Array]:
    """Correlation of two series with missing samples at every lag, the lags, and how many samples are in common."""
    known_y, known_x = ~np.isnan(y) * 1.0, ~np.isnan(x) * 1.0
    y, x = (np.nan_to_num(each - np.nanmean(each)) / (np.nanstd(each) + 1e-12) for each in (y, x))

    def over(one: Array, other: Array) -> Array:
        return np.asarray(signal.correlate(one, other, method="fft"))

    common = np.round(over(known_y, known_x))
    count = np.maximum(common, 1.0)
    mean_y, mean_x = over(y, known_x) / count, over(known_y, x) / count
    variance_y, variance_x = over(y**2, known_x) / count - mean_y**2, over(known_y, x**2) / count - mean_x**2
    product = over(y, x) / count - mean_y * mean_x
    enough = (common > 10) & (variance_y > 1e-4) & (variance_x > 1e-4)
    correlation = np.where(enough, product / np.sqrt(np.where(enough, variance_y * variance_x, 1.0)), 0.0)
    return np.clip(correlation, -1.0, 1.0), signal.correlation_lags(len(y), len(x)), common


def _refined(match: _Match, lags_s: Sequence[float]) -> ClockShift:
    """Shift and logarithms of the lags by least squares."""
    y, x = match.y, match.x
    step_s = np.array([match.period_s / 2, *[0.05] * len(lags_s)])
    start = np.array([match.shift_s, *np.log(lags_s)])
    room_s = 4 * match.period_s + 2 * sum(lags_s)

    def curve(p: Array) -> Array:
        return x.at(y.time_s - p[0], tuple(np.exp(p[1:]).tolist()))

    known = ~np.isnan(x.at(y.time_s - start[0] - room_s) + x.at(y.time_s - start[0] + room_s) + curve(start))
    known = known if known.sum() > 50 else ~np.isnan(curve(start))
    values = y.values[known]

    def residual(p: Array) -> Array:
        bent = curve(p)[known]
        return _projected(values, np.where(np.isnan(bent), np.nanmean(bent), bent))

    def slope(p: Array) -> Array:
        moves = np.diag(step_s)
        return np.stack([(residual(p + each) - residual(p - each)) / (2 * each.sum()) for each in moves], axis=1)

    low = start - np.array([room_s, *[7.0] * len(lags_s)])
    high = start + np.array([room_s, *[4.0] * len(lags_s)])
    found = least_squares(residual, start, slope, bounds=(low, high), x_scale=step_s, max_nfev=50)
    left, jacobian = residual(found.x), slope(found.x)
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    scores = [part.sum(axis=0) for part in np.array_split(jacobian * left[:, None], _BLOCKS)]
    covariance = bread @ (np.transpose(scores) @ np.array(scores)) @ bread * _BLOCKS / (_BLOCKS - 1)
    fitted_s, explained = tuple(np.exp(found.x[1:]).tolist()), float(1 - left.var() / max(values.var(), 1e-12))
    error_s = np.hypot(np.sqrt(covariance[0, 0]), _DRAWN * min(y.period_s, x.period_s))
    half = float(student.ppf(0.975, _BLOCKS - 1) * error_s) + _NO_LAG * sum(fitted_s)
    value, problem = y.sign * float(found.x[0]), match.problem
    if problem is None and explained < _LEAST_EXPLAINED["related" if lags_s else "same"]:
        problem = f"they share only {100 * explained:.0f} % of their variance"
    columns = (y.name, x.name) if y.sign > 0 else (x.name, y.name)
    return ClockShift(value, (value - half, value + half), columns, fitted_s, explained, problem)


def _projected(y: Array, x: Array) -> Array:
    """``y`` (N,) less its regression on ``x`` and a constant."""
    x, y = x - x.mean(), y - y.mean()
    return np.asarray(y - x * (x @ y) / max(float(x @ x), 1e-12))
