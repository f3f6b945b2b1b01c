"""Devices step by step, for closed loops: what the open-loop simulation computes, with its state held between samples.

The demand holds from a sample to the next; the air goes in a straight line between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti.lag import lag_weights
from ambient_trainer.simulator.device import Device, Zone
from ambient_trainer.simulator.heat import Demand, HeatBalance, Rates, rk4_step
from ambient_trainer.simulator.instruments import felt_weights, reported

Array = NDArray[np.float64]

LONGEST_STEP_S = 1.0


class Stepper:
    """A batch of units of one device with the sensors of some zones.

    Parameters
    ----------
    devices : sequence of Device
        The units.
    zones : sequence of Zone
        Of which readings are taken.
    period_s : float
        Between two steps.

    Notes
    -----
    :meth:`start` gives the steady state. Each :meth:`step` integrates the heat balance over ``period_s`` by RK4 in
    steps of at most ``LONGEST_STEP_S``, and the sensors' first-order lags exactly for a straight line.
    """

    def __init__(self, devices: Sequence[Device], zones: Sequence[Zone], period_s: float) -> None:
        self.balance = HeatBalance(devices)
        self.zones = tuple(zones)
        self._period_s = period_s
        self._weights = np.array([[felt_weights(zone, device) for zone in zones] for device in devices])
        self._lag = lag_weights([zone.lag_s for zone in zones], period_s)
        self.nodes_degC = np.empty((len(devices), self.balance.size))
        """Shape (batch, nodes)."""
        self._under = self._felt = np.empty((len(devices), len(zones)))

    def start(self, air_degC: Array, demand: Demand) -> None:
        """Begin in the steady state with air of shape (batch,)."""
        self.nodes_degC = self.balance.equilibrium(air_degC, demand)
        self._under = self._felt = self._mixed()

    def step(self, demand: Demand, air_degC: tuple[Array, Array]) -> None:
        """Go to the next sample, while the air goes from one temperature to another, shape (batch,) each."""
        self.nodes_degC = advanced(self.balance.rates, self.nodes_degC, demand, air_degC, self._period_s)
        under = self._mixed()
        self._felt, self._under = self._lag.step(self._felt, self._under, under), under

    def readings_degC(self, noise: Array) -> Array:
        """What the zones report with ``noise`` of unit variance, both of shape (batch, zones)."""
        columns = [reported(zone, self._felt[:, k], noise[:, k]) for k, zone in enumerate(self.zones)]
        return np.stack(columns, axis=1)

    def _mixed(self) -> Array:
        """The temperature under each zone's sensor, shape (batch, zones)."""
        mixed: Array = np.einsum("bzn,bn->bz", self._weights, self.nodes_degC)
        return mixed


def advanced(rates: Rates, state: Array, demand: Demand, air_degC: tuple[Array, Array], period_s: float) -> Array:
    """The state one sample later, while the air goes straight from the one temperature to the other."""
    now, slope_K_s = air_degC[0], (air_degC[1] - air_degC[0]) / period_s
    substeps = math.ceil(period_s / LONGEST_STEP_S)
    step_s = period_s / substeps

    def derivative(elapsed_s: float, nodes: Array) -> Array:
        return rates(nodes, now + slope_K_s * elapsed_s, demand)

    for substep in range(substeps):
        state = rk4_step(derivative, substep * step_s, state, step_s)
    return state
