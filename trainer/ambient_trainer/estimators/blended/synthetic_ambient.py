"""A synthetic ambient: random set points, reached at the log's rate of change, with the log's swing and noise.

The swing is fitted where the log's reference is calmest: the strongest sinusoid of that hour, and what is left of it
as first-order noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_model.faults import refuse
from ambient_trainer.estimators.blended.recipe import Synthetic

Array = NDArray[np.float64]

_CALM_S = 3600.0
_SMOOTHED_S = 900.0
_SWING_PERIODS_S = np.geomspace(120.0, 1800.0, 200)
_STEEP_PERCENT = 99.5
_STEEP_OVER_S = 60.0


@dataclass(frozen=True)
class AmbientModel:
    """How an ambient changes."""

    slope_K_s: float
    """Its rate of change to another set point."""
    swing_K: float
    swing_period_s: float
    noise_K: float
    noise_memory: float
    """The correlation of the noise with its next sample."""
    period_s: float


def fit_ambient(ambients_degC: Sequence[Array], period_s: float, source: str) -> AmbientModel:
    """Fitted to ambients of N samples each; raises :class:`Refused` where none of them is an hour long."""
    window, minute = round(_CALM_S / period_s), max(1, round(_STEEP_OVER_S / period_s))
    long = [each for each in ambients_degC if len(each) > window]
    if not long:
        raise refuse(source, "", "no hour without a gap", "log longer: the ambient's own swing is fitted to one")
    # in minutes of the whole log, most of which are calm
    steps = np.concatenate([np.abs(np.diff(each[::minute])) for each in long])
    calm = _calmest(long, window, period_s)
    calm = calm - calm.mean()
    swing_period_s, swing, rest = _strongest(calm, period_s)
    return AmbientModel(
        slope_K_s=float(np.percentile(steps, _STEEP_PERCENT)) / (minute * period_s),
        swing_K=swing,
        swing_period_s=swing_period_s,
        noise_K=float(rest.std()),
        noise_memory=float(np.clip(float(rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-12), 0.0, 0.999)),
        period_s=period_s,
    )


def synthetic_ambient(ambient: AmbientModel, rule: Synthetic, count: int, random: np.random.Generator) -> Array:
    """An ambient of ``count`` samples, (N,), through set points that the rule allows."""
    T = ambient.period_s
    set_points: list[float] = []
    while len(set_points) < count:
        stay = max(1, round(random.uniform(*rule.stay_min) * 60.0 / T))
        set_points += [random.uniform(*rule.ambient_degC)] * stay
    step, now, ramp = ambient.slope_K_s * T, set_points[0], np.empty(count)
    for index in range(count):
        ramp[index] = now
        now += min(max(set_points[index] - now, -step), step)
    kept = math.exp(-T / rule.settling_s)
    settled = lfilter([1 - kept], [1.0, -kept], ramp - ramp[0]) + ramp[0]
    phase = random.uniform(0.0, 2.0 * math.pi)
    swing = ambient.swing_K * np.sin(2.0 * math.pi * T * np.arange(count) / ambient.swing_period_s + phase)
    white = random.standard_normal(count)
    white[1:] *= math.sqrt(1.0 - ambient.noise_memory**2)
    return np.asarray(settled + swing + ambient.noise_K * lfilter([1.0], [1.0, -ambient.noise_memory], white))


def _calmest(ambients_degC: Sequence[Array], window: int, period_s: float) -> Array:
    """The hour whose average over a quarter of an hour moves least."""
    smoothed = max(1, round(_SMOOTHED_S / period_s))
    stride = max(1, round(300.0 / period_s))
    best, calmest = math.inf, ambients_degC[0][:window]
    for each in ambients_degC:
        mean = np.convolve(each, np.full(smoothed, 1 / smoothed), "valid")
        for start in range(0, len(each) - window, stride):
            moved = float(np.ptp(mean[start : start + window - smoothed + 1]))
            if moved < best:
                best, calmest = moved, each[start : start + window]
    return calmest


def _strongest(values: Array, period_s: float) -> tuple[float, float, Array]:
    """Period (s), amplitude and rest of the sinusoid that explains most of ``values``."""
    time_s = period_s * np.arange(len(values))
    best: tuple[float, float, float, Array] | None = None
    for swing_period_s in _SWING_PERIODS_S.tolist():
        angle = 2.0 * math.pi * time_s / swing_period_s
        table = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
        weights = np.linalg.lstsq(table, values, rcond=None)[0]
        rest = values - table @ weights
        left = float(rest @ rest)
        if best is None or left < best[0]:
            best = (left, swing_period_s, float(np.hypot(weights[0], weights[1])), rest)
    assert best is not None  # there are periods
    return best[1:]
