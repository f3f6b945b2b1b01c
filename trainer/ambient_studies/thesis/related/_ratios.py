"""Ratios of first-order responses as a structure to be fitted: one an input, time constants searched, gains solved for.

    y = offset + sum_i K_i (1 + tau1_i s)/(1 + tau2_i s) u_i = offset + sum_i d_i (u_i - L_i u_i) + K_i L_i u_i

with L_i = 1/(1 + tau2_i s) and d_i = K_i tau1_i / tau2_i: d and K have one sign where every time constant is positive.
"""

import math
from collections.abc import Sequence

import numpy as np

from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation import Structure, Unknowns
from ambient_trainer.lti import StateSpace, lagged, response_slopes

_FASTEST_PERIODS = 2.0
_TIMES_SHOWN = 10.0


class FirstOrderRatios(Structure):
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

    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """u - L u and L u of each input, and one."""
        u, period_s = self.segments[index].inputs, self.segments[index].period_s
        slow = np.array([lagged(row, tau_s, period_s) for row, tau_s in zip(u, np.exp(theta).tolist())])
        one = np.ones((1, u.shape[1]))
        return 0 * one, np.concatenate([u - slow, slow, one])[:, None]

    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """K - d times the derivative of L in log tau2: 1/tau2 there moves by -1/tau2."""
        segment, m = self.segments[index], self.inputs
        found = []
        for row, rate, gain in zip(segment.inputs, np.exp(-theta), beta[m : 2 * m] - beta[:m]):
            zero, one = np.zeros((1, 1)), np.ones((1, 1))
            lag = StateSpace(-rate * one, rate * one, gain * one, zero, zero[0])
            by = StateSpace(rate * one[None], -rate * one[None], zero[None], zero[None], zero)
            found.append(response_slopes(lag, by, "first-order", row[None], segment.period_s)[0])
        return np.array(found)

    def random_start(self, random: np.random.Generator) -> Array:
        """Time constants drawn log-uniformly between the bounds."""
        return random.uniform(self.search.low, self.search.high)
