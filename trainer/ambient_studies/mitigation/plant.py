"""Simulated phones in closed loop: what the open-loop simulation computes, with a cap on the SoC at each step."""

from collections.abc import Sequence

import numpy as np

from ambient_trainer.data import Array
from ambient_trainer.simulator import Demand, Run, Stepper, Zone, load_device, stream

SKIN = ("display", "back", "frame")
"""The nodes of the phone's surface."""


def skin_degC(nodes_degC: Array) -> Array:
    """The hottest surface node, shape (...), of nodes of shape (..., nodes)."""
    hottest: Array = nodes_degC[..., [load_device().index(node) for node in SKIN]].max(axis=-1)
    return hottest


class Plant:
    """A batch of phones, each on its run with the sensor noise of its seed, at the runs' first sample.

    The runs have the same number of samples, ``period_s`` apart; phones of one seed see the same noise.
    """

    def __init__(self, runs: Sequence[Run], seeds: Sequence[int], zones: Sequence[Zone], period_s: float) -> None:
        self._stepper = Stepper([run.device for run in runs], zones, period_s)
        self._air = np.stack([run.air_degC for run in runs], axis=1)
        self._activity = np.stack([run.activity for run in runs], axis=1)
        self._burst = np.stack([run.burst for run in runs], axis=1)
        self._noise = _noise(seeds, zones, len(self._air))
        self._sample = 0
        self._stepper.start(self._air[0], self._stepper.balance.demand(self._activity[0], np.ones(len(runs))))

    @property
    def nodes_degC(self) -> Array:
        """The nodes, shape (batch, nodes)."""
        return self._stepper.nodes_degC

    @property
    def air_degC(self) -> Array:
        """The air, shape (batch,)."""
        return self._air[self._sample]

    @property
    def readings_degC(self) -> Array:
        """What the zones report now, shape (batch, zones)."""
        return self._stepper.readings_degC(self._noise[self._sample])

    def drawn_W(self, cap_W: Array) -> Array:
        """What the SoCs draw now under caps of shape (batch,), the die's own protection taken off."""
        balance = self._stepper.balance
        return balance.drawn(self.nodes_degC, self._demand(cap_W))[0][:, balance.processor]

    def step(self, cap_W: Array) -> None:
        """Advance by one sample under caps of shape (batch,), in W; infinity caps nothing."""
        self._stepper.step(self._demand(cap_W), (self._air[self._sample], self._air[self._sample + 1]))
        self._sample += 1

    def _demand(self, cap_W: Array) -> Demand:
        balance = self._stepper.balance
        demand = balance.demand(self._activity[self._sample], self._burst[self._sample])
        demand.heat_W[:, balance.processor] = np.minimum(demand.heat_W[:, balance.processor], cap_W)
        return demand


def _noise(seeds: Sequence[int], zones: Sequence[Zone], count: int) -> Array:
    """Of unit variance, shape (count, batch, zones): what the open-loop simulation draws for these seeds."""
    known = {
        seed: np.stack([stream(seed, f"zone {zone.name}").standard_normal(count) for zone in zones], axis=1)
        for seed in set(seeds)
    }
    return np.stack([known[seed] for seed in seeds], axis=1)
