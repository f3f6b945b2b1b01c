"""The first-order lag of samples at any times, from equilibrium with the first and after each gap.

A gap is one that is longer than a device bridges.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from ambient_model.tracking import bridge_limit_s
from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lag_weights


def lagged(time_s: Array, values: Array, time_constant_s: float) -> Array:
    """The response to ``values`` (n,), none missing, at ``time_s`` (n,), n >= 1; same unit and shape."""
    steps_s = np.diff(time_s)
    decay, before, now = lag_weights(time_constant_s, steps_s)
    push = before * values[:-1] + now * values[1:]
    period_s = sampling_period_s(time_s)
    afresh = np.floor(steps_s / period_s + 0.5) > round(bridge_limit_s(period_s) / period_s)
    decay[afresh], push[afresh] = 0.0, values[1:][afresh]
    states = accumulate(
        zip(decay.tolist(), push.tolist()), lambda x, step: step[0] * x + step[1], initial=float(values[0])
    )
    return np.fromiter(states, dtype=np.float64, count=len(values))
