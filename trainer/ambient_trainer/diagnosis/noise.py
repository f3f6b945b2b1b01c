"""What is left of a good simulation is no white noise: each sensor's residual remembers.

Each is taken as an autoregression, and what is compared is whitened by it: e[k] - sum_i a_i e[k-i], over the standard
deviation of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]

ORDER = 4
LEAK = 0.9
_RIDGE = 1e-6
_QUANTUM = 1e-3
"""degC; no instrument is better."""


@dataclass(frozen=True)
class Noise:
    """Per sensor: the memory a (s, p), and the innovation's and the whole residual's standard deviation, (s,)."""

    memory: Array
    innovation_degC: Array
    deviation_degC: Array

    @staticmethod
    def of(residuals: Sequence[Array]) -> Noise:
        """The noise that residuals (s, N) of several records have in common; NaN where there is none."""
        return Noise(
            *map(
                np.array, zip(*(_autoregression([each[row] for each in residuals]) for row in range(len(residuals[0]))))
            )
        )

    def white(self, rows: Array) -> Array:
        """``rows`` (..., s, N) as (..., s, N - p) of unit variance where they are this noise."""
        count = rows.shape[-1] - ORDER
        moved = rows[..., ORDER:].copy()
        for lag in range(1, ORDER + 1):
            moved -= self.memory[:, lag - 1, None] * rows[..., ORDER - lag : ORDER - lag + count]
        moved /= self.innovation_degC[:, None]
        return np.asarray(moved)


def _autoregression(rows: Sequence[Array]) -> tuple[Array, float, float]:
    """Autoregression, innovation's and whole deviation of one sensor's residuals in several records."""
    windows = np.concatenate([sliding_window_view(row, ORDER + 1) for row in rows if len(row) > ORDER])
    windows = windows[~np.isnan(windows).any(axis=1)]
    if len(windows) < 4 * ORDER:
        return np.zeros(ORDER), 1.0, 1.0
    past, now = windows[:, -2::-1], windows[:, -1]
    normal = past.T @ past
    ridge = _RIDGE * np.trace(normal) / ORDER + _QUANTUM**2
    memory = np.linalg.solve(normal + ridge * np.eye(ORDER), past.T @ now)
    memory = memory * LEAK ** np.arange(1, ORDER + 1)
    innovation = float(np.sqrt(np.mean((now - past @ memory) ** 2)))
    return memory, max(innovation, _QUANTUM), max(float(np.sqrt(np.mean(now**2))), _QUANTUM)
