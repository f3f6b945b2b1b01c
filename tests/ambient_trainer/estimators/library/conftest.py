"""Runs of a circuit under a walking ambient, simulated by small steps that share nothing with the filters."""

from functools import cache

import numpy as np
from scipy.signal import lfilter

from ambient_trainer.data.trace import Trace

SUBSTEP_S = 0.5


@cache
def walked(
    seed: int,
    samples: int = 4000,
    period_s: float = 10.0,
    tau_s: tuple[float, ...] = (60.0, 200.0, 120.0),
    exchange: float = 0.004,
    walk: float = 0.3,
    node_walk: float = 0.02,
    noise_degC: float = 0.05,
) -> Trace:
    """Sensors a, b, c over an ambient that walks at random; Euler-Maruyama, half a second a step."""
    random = np.random.default_rng(seed)
    dt, n = SUBSTEP_S, len(tau_s)
    every = round(period_s / dt)
    kicks = random.standard_normal((samples * every, n + 1)) * np.sqrt(dt)
    M = np.eye(n + 1)
    M[:n, :n] += dt * (exchange - np.diag(1 / np.array(tau_s) + n * exchange))
    M[:n, n] = dt / np.array(tau_s)
    rates, modes = np.linalg.eig(M)
    driven = np.linalg.solve(modes, (kicks * ([node_walk] * n + [walk])).T)
    before = np.roll(driven, 1, axis=1)
    before[:, 0] = 0.0
    states = 20.0 + modes @ np.array([lfilter([1.0], [1.0, -rate], row) for rate, row in zip(rates, before)])
    seen, truth = states[:n, ::every], states[n, ::every]
    seen = seen + noise_degC * random.standard_normal(seen.shape)
    columns = {f"{name}_degC": row for name, row in zip("abc", seen)}
    return Trace(f"walked {seed}", np.arange(samples) * period_s, {**columns, "ambient_degC": truth})
