"""Runs of a circuit under a walking ambient, simulated by small steps that share nothing with the filters."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

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
    rate = 1 / np.array(tau_s)
    ambient, nodes = 20.0, np.full(n, 20.0)
    seen, truth = np.empty((n, samples)), np.empty(samples)
    for k in range(samples):
        seen[:, k], truth[k] = nodes, ambient
        for kick in random.standard_normal((round(period_s / dt), n + 1)) * np.sqrt(dt):
            flow = rate * (ambient - nodes) + exchange * (nodes.sum() - n * nodes)
            nodes = nodes + dt * flow + node_walk * kick[:n]
            ambient += walk * kick[n]
    seen += noise_degC * random.standard_normal(seen.shape)
    columns = {f"{name}_degC": row for name, row in zip("abc", seen)}
    return Trace(f"walked {seed}", np.arange(samples) * period_s, {**columns, "ambient_degC": truth})


@pytest.fixture(scope="session")
def simulated() -> Callable[..., Trace]:
    return walked
