"""The free filter under two constraints of physics, each a synthetic run that it is fitted to like any other.

- All sensors one degree up is the estimate one degree up: from a run in which every sensor shows one value, always.
- White noise on the sensors, beyond the logged: from an impulse of each sensor alone, whose target is zero. What is
  left is the impulse response, whose square sum is the square of the noise gain.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.free_filter import FreeFilter

Array = NDArray[np.float64]

_STEADY = 8
"""Samples of the run at a constant level: as many as a filter's delays need."""
_IMPULSE = 300
"""Samples of an impulse response; what comes later is small and slow."""


class ConstrainedFilter(FreeFilter):
    """The free filter of order N over segments, as if each sensor had ``noise_degC`` more white noise than logged."""

    def __init__(self, order: int, logged: Sequence[Segment], noise_degC: float) -> None:
        period_s, inputs = logged[0].period_s, logged[0].inputs.shape[0]
        known = np.concatenate([each.outputs[0] for each in logged])
        known = known[~np.isnan(known)]
        size = float(np.linalg.norm(known))
        level = Segment(
            period_s, np.full((inputs, _STEADY), size), np.where(np.arange(_STEADY) > 0, np.nan, size)[None]
        )
        length = min(_IMPULSE, max(each.inputs.shape[1] for each in logged))
        impulse = noise_degC * np.sqrt(len(known))
        impulses = [_impulse(period_s, inputs, index, impulse, length) for index in range(inputs)]
        super().__init__(order, [*logged, level, *impulses])
        self.logged = len(logged)

    def signals(self, theta: Array, index: int) -> Array:
        """As the free filter's; the constraints have no offset."""
        found = super().signals(theta, index)
        if index >= self.logged:
            found[self.inputs] = 0.0
        return found


def _impulse(period_s: float, inputs: int, index: int, impulse: float, length: int) -> Segment:
    u = np.zeros((inputs, length))
    # the first sample sets the equilibrium
    u[index, 1] = impulse
    return Segment(period_s, u, np.zeros((1, length)))
