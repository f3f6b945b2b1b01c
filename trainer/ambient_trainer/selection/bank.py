"""Every candidate filter shares one bank of fixed real poles, so its gains are a small least-squares problem.

Of each sensor the bank holds the reading u and what a first-order lag 1 / (tau_j s + 1) makes of it, of unit gain at
rest and in equilibrium with the first sample. With the poles shared, K of them make a filter of K states, however many
sensors it reads.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti.lag import lag_weights, lagged
from ambient_trainer.lti.statespace import StateSpace

Array = NDArray[np.float64]

_FASTEST_PERIODS = (1.0, 2.0, 5.0, 10.0)
_RATIOS = (3.0, 5.0, 8.0)
_TIMES_SHOWN = 20


def banks(order: int, period_s: float, longest_s: float) -> list[tuple[float, ...]]:
    """The banks to choose from: ``order`` time constants in s, fastest first, in one ratio each.

    The slowest is shown twenty times by the longest stretch: one that is shown once or twice tells the run's age.
    """
    found = [
        tuple(float(f"{fastest * period_s * ratio**k:.4g}") for k in range(order))
        for fastest in _FASTEST_PERIODS
        for ratio in _RATIOS
    ]
    shown = [each for each in found if each[-1] <= longest_s / _TIMES_SHOWN]
    return list(dict.fromkeys(shown or [min(found, key=lambda each: each[-1])]))


def low_passes(readings: Array, poles_s: Sequence[float], period_s: float) -> Array:
    """The bank over ``readings`` (m, N): shape (m, 1 + K, N), the reading itself first."""
    return np.stack([readings, *(lagged(readings, tau_s, period_s) for tau_s in poles_s)], axis=1)


def noise_gram(poles_s: Sequence[float], period_s: float) -> Array:
    """N (1 + K, 1 + K), the impulse responses' inner products: b' N b is the variance that b makes of white noise.

    h_i is n_i at first and then c_i a_i^k with c_i = n_i a_i + p_i, so <h_i, h_j> = n_i n_j + c_i c_j / (1 - a_i a_j);
    the reading itself is n = 1, c = 0.
    """
    a, before, now = np.array([(0.0, 0.0, 1.0), *(lag_weights(tau_s, period_s) for tau_s in poles_s)]).T
    after = now * a + before
    gram: Array = np.outer(now, now) + np.outer(after, after) / (1 - np.outer(a, a))
    return gram


def bank_system(poles_s: Sequence[float], gains: Array, offset_degC: float) -> StateSpace:
    """The continuous system of ``gains`` (m, 1 + K) over the bank, with K states."""
    rates = 1 / np.asarray(poles_s, dtype=float)
    return StateSpace(
        A=-np.diag(rates),
        B=gains[:, 1:].T * rates[:, None],
        C=np.ones((1, len(rates))),
        D=gains[:, :1].T,
        offset=np.array([offset_degC]),
    )
