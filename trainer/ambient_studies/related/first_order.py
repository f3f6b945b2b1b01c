"""The first-order response 1/(1 + tau s) to samples at any times, which are joined by straight lines.

With h = dt / tau and e = exp(-h) it is exactly

    x[k+1] = e x[k] + (1 - e) u[k] + (1 - (1 - e)/h) (u[k+1] - u[k]),

from the equilibrium x[0] = u[0]; after a gap longer than a device bridges it starts again from equilibrium.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from ambient_model.tracking import bridge_limit_s
from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Array


def lagged(time_s: Array, values: Array, time_constant_s: float) -> Array:
    """The response to ``values`` (n,), none missing, at ``time_s`` (n,), n >= 1; same unit and shape."""
    steps_s = np.diff(time_s)
    h = steps_s / time_constant_s
    decay, gain = np.exp(-h), -np.expm1(-h)
    push = gain * values[:-1] + (1.0 - gain / h) * np.diff(values)
    period_s = sampling_period_s(time_s)
    afresh = np.floor(steps_s / period_s + 0.5) > round(bridge_limit_s(period_s) / period_s)
    decay[afresh], push[afresh] = 0.0, values[1:][afresh]
    states = accumulate(
        zip(decay.tolist(), push.tolist()), lambda x, step: step[0] * x + step[1], initial=float(values[0])
    )
    return np.fromiter(states, dtype=np.float64, count=len(values))
