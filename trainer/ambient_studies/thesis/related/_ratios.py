"""Ratios of first-order responses as a structure to be fitted: one an input, time constants searched, gains solved for.

    y = offset + sum_i K_i (1 + tau1_i s)/(1 + tau2_i s) u_i = offset + sum_i d_i (u_i - L_i u_i) + K_i L_i u_i

with L_i = 1/(1 + tau2_i s) and d_i = K_i tau1_i / tau2_i: d and K have one sign where every time constant is positive.
Between the samples the inputs move along straight lines; with h = T / tau2, e = exp(-h) and phi = (1 - e)/h that makes
L exactly

    1 - phi + (1 - e) phi / (z - e).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation import Expansion, Unknowns
from ambient_trainer.lti import one_pole

_FASTEST_PERIODS = 2.0
_TIMES_SHOWN = 10.0


class FirstOrderRatios:
    """The structure over segments of one period; theta is the logarithm of each tau2 in s, beta is d, K, offset.

    ``signs`` holds +1 or -1 an input, the sign of its K and d.
    """

    def __init__(self, segments: Sequence[Segment], signs: Sequence[int]) -> None:
        self.segments = segments
        self.inputs = m = segments[0].inputs.shape[0]
        period_s = segments[0].period_s
        longest_s = max(segment.inputs.shape[1] for segment in segments) * period_s
        fastest = math.log(_FASTEST_PERIODS * period_s)
        slowest = max(math.log(longest_s / _TIMES_SHOWN), fastest + 1.0)
        low, high = np.full(m, fastest), np.full(m, slowest)
        self.search = Unknowns(tuple(f"tau{i + 1}" for i in range(m)), (low + high) / 2, low, high)
        names = [f"{gain}{i + 1}" for gain in "dK" for i in range(m)]
        low = np.array([0.0 if sign > 0 else -np.inf for sign in (*signs, *signs)] + [-np.inf])
        high = np.array([np.inf if sign > 0 else 0.0 for sign in (*signs, *signs)] + [np.inf])
        self.linear = Unknowns((*names, "offset"), np.zeros(2 * m + 1), low, high)

    def signals(self, theta: Array, index: int) -> Array:
        """The inputs, the inputs over their z - e, one, the inputs over their (z - e)^2."""
        segment = self.segments[index]
        u = segment.inputs
        once, twice = np.empty_like(u), np.empty_like(u)
        for i, e in enumerate(np.exp(-segment.period_s / np.exp(theta))):
            once[i] = one_pole(e, u[i, None], u[i, :1] / (1 - e))[0]
            twice[i] = one_pole(e, once[i, None], once[i, :1] / (1 - e))[0]
        return np.concatenate([u, once, np.ones((1, u.shape[1])), twice])

    def expand(self, theta: Array, period_s: float) -> Expansion:
        """L of each input in its three signals, and its derivative in log tau2.

        There h moves by -h, e by e h and phi by phi - e.
        """
        m = self.inputs
        h = period_s / np.exp(theta)
        e = np.exp(-h)
        phi = -np.expm1(-h) / h
        each, p, s = np.arange(m), 2 * m + 1, 3 * m + 1
        lag, moved = np.zeros((m, s)), np.zeros((m, s))
        lag[each, each], lag[each, m + each] = 1 - phi, (1 - e) * phi
        moved[each, each], moved[each, m + each] = e - phi, (1 - e) * (phi - e) - e * h * phi
        moved[each, p + each] = (1 - e) * phi * e * h
        free = np.zeros((1, s, p))
        free[0, :, :m], free[0, :, m : 2 * m], free[0, 2 * m, 2 * m] = np.eye(s, m) - lag.T, lag.T, 1.0
        slope = np.zeros((m, 1, s, p))
        slope[each, 0, :, each], slope[each, 0, :, m + each] = -moved, moved
        return Expansion(np.zeros((1, s)), free, np.zeros((m, 1, s)), slope)

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """No penalty: the bounds hold the prior."""
        return np.zeros(0), np.zeros((0, len(theta)))

    def regrouped(self, theta: Array) -> Array:
        """There are no better coordinates."""
        return theta

    def random_start(self, random: np.random.Generator) -> Array:
        """Time constants drawn log-uniformly between the bounds."""
        return random.uniform(self.search.low, self.search.high)
