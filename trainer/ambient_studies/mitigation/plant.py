"""Simulated phones that are stepped: what the open-loop simulation computes, with a cap on the SoC at each step.

Between two samples the demand is held and the air goes in a straight line, as in :mod:`ambient_trainer.simulator.run`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti.lag import lag_weights
from ambient_trainer.simulator.constants import NODES
from ambient_trainer.simulator.heat import SOC, Demand, HeatBalance
from ambient_trainer.simulator.instruments import felt_weights, reported
from ambient_trainer.simulator.run import Run, advanced, stream
from ambient_trainer.simulator.zones import Zone

Array = NDArray[np.float64]

SKIN = ("display", "back", "frame")
"""The nodes that a hand lies on."""
_SKIN = [NODES.index(node) for node in SKIN]


def skin_degC(nodes_degC: Array) -> Array:
    """The hottest of what a hand touches, shape (...), of nodes of shape (..., nodes)."""
    hottest: Array = nodes_degC[..., _SKIN].max(axis=-1)
    return hottest


class Plant:
    """A batch of phones, each on its run with the sensor noise of its seed, at the runs' first sample.

    The runs have the same number of samples, ``period_s`` apart; phones of one seed see the same noise.
    """

    def __init__(self, runs: Sequence[Run], seeds: Sequence[int], zones: Sequence[Zone], period_s: float) -> None:
        self._balance = HeatBalance([run.phone for run in runs])
        self._air = np.stack([run.air_degC for run in runs], axis=1)
        self._activity = np.stack([run.activity for run in runs], axis=1)
        self._burst = np.stack([run.burst for run in runs], axis=1)
        self._zones = tuple(zones)
        self._period_s = period_s
        self._weights = np.array([[felt_weights(zone, run.phone) for zone in zones] for run in runs])
        self._lag = lag_weights([zone.lag_s for zone in zones], period_s)
        self._noise = _noise(seeds, zones, len(self._air))
        self._sample = 0
        resting = self._balance.demand(self._activity[0], np.ones(len(runs)))
        self.nodes_degC = self._balance.equilibrium(self._air[0], resting)
        self._touched = self._mixed()
        self._felt = self._touched

    @property
    def air_degC(self) -> Array:
        """The air, shape (batch,)."""
        return self._air[self._sample]

    @property
    def readings_degC(self) -> Array:
        """What the zones report now, shape (batch, zones)."""
        noise = self._noise[self._sample]
        columns = [reported(zone, self._felt[:, k], noise[:, k]) for k, zone in enumerate(self._zones)]
        return np.stack(columns, axis=1)

    def drawn_W(self, cap_W: Array) -> Array:
        """What the SoCs draw now under caps of shape (batch,), the die's own protection taken off."""
        return self._balance.drawn(self.nodes_degC, self._demand(cap_W))[0][:, SOC]

    def step(self, cap_W: Array) -> None:
        """Go on to the next sample under caps of shape (batch,), in W; infinity caps nothing."""
        air = self._air[self._sample], self._air[self._sample + 1]
        self.nodes_degC = advanced(self._balance, self.nodes_degC, self._demand(cap_W), air, self._period_s)
        self._sample += 1
        touched = self._mixed()
        self._felt = self._lag.step(self._felt, self._touched, touched)
        self._touched = touched

    def _demand(self, cap_W: Array) -> Demand:
        demand = self._balance.demand(self._activity[self._sample], self._burst[self._sample])
        demand.heat_W[:, SOC] = np.minimum(demand.heat_W[:, SOC], cap_W)
        return demand

    def _mixed(self) -> Array:
        """What is under each zone's sensor, shape (batch, zones)."""
        mixed: Array = np.einsum("bzn,bn->bz", self._weights, self.nodes_degC)
        return mixed


def _noise(seeds: Sequence[int], zones: Sequence[Zone], count: int) -> Array:
    """Of unit variance, shape (count, batch, zones): what the open-loop simulation draws for these seeds."""
    known = {
        seed: np.stack([stream(seed, f"zone {zone.name}").standard_normal(count) for zone in zones], axis=1)
        for seed in set(seeds)
    }
    return np.stack([known[seed] for seed in seeds], axis=1)
