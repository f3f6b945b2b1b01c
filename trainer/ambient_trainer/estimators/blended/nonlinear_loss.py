"""A circuit simulated forward with a loss that is not proportional to the rise, and sensors that lag behind it.

A surface at T in air at T_a gives off, with dT = T - T_a,

    q = G dT f,   f = (1 - rho) ((dT^2 + 0.25 K^2) / rise^2)^(exponent / 2) + rho (T_mean / T_ref)^3

with T_mean = (T + T_a) / 2 in kelvin: natural convection and linearised radiation, each 1 at ``at_rise_K`` and
``at_degC`` (Incropera and DeWitt, chapters 1 and 9). The linear circuit is solved exactly in its modes under a
first-order hold; what the loss differs from G dT, as heat into the surface, is found by iterating: some four passes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.estimators.blended.recipe import Loss
from ambient_trainer.lti.lag import lagged

_LEAST_RISE_K2 = 0.25
"""Keeps the law smooth where the rise changes its sign."""
_KELVIN = 273.15


@dataclass(frozen=True)
class Plant:
    """A circuit with n states in its modes, and m sensors on some of them."""

    rates: Array
    """(n,), 1/s, all below 0."""
    right: Array
    """(n, n): node temperatures from modes."""
    left: Array
    """(n, n): modes from node temperatures."""
    capacitance: Array
    """(n,), J/K."""
    to_ambient: Array
    """(n,), W/K: the conductance of each node to the ambient."""
    rho: float
    sensor_nodes: NDArray[np.intp]
    lags_s: Array
    """(m,)"""


def factor(rise_K: Array, mean_degC: Array, rho: float, loss: Loss) -> Array:
    """f: the loss as a multiple of G dT."""
    convection = ((rise_K**2 + _LEAST_RISE_K2) / loss.at_rise_K**2) ** (loss.exponent / 2)
    radiation = ((mean_degC + _KELVIN) / (loss.at_degC + _KELVIN)) ** 3
    return np.asarray((1 - rho) * convection + rho * radiation)


def simulate(plant: Plant, loss: Loss, ambient_degC: Array, heat_W: Array, period_s: float, passes: int) -> Array:
    """What the sensors read, (m, N), for the ambient (N,) and the heat into the nodes (n, N).

    From thermal equilibrium with the first sample; ``passes`` of the iteration.
    """
    surfaces = np.flatnonzero(plant.to_ambient)
    extra = np.zeros_like(heat_W)
    for index in range(passes):
        heat = plant.to_ambient[:, None] * ambient_degC + (heat_W + extra)
        drive = plant.left @ (heat / plant.capacitance[:, None])
        modes = [lagged(row / -rate, -1 / rate, period_s) for row, rate in zip(drive, plant.rates.tolist())]
        nodes = plant.right @ np.array(modes)
        if index < passes - 1:
            rise = nodes[surfaces] - ambient_degC
            bent = factor(rise, (nodes[surfaces] + ambient_degC) / 2, plant.rho, loss)
            extra[surfaces] = -plant.to_ambient[surfaces, None] * rise * (bent - 1)
    return np.vstack([lagged(nodes[n], lag, period_s) for n, lag in zip(plant.sensor_nodes, plant.lags_s)])
