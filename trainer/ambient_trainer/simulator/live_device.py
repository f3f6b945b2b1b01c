"""A device, second by second, for who asks while it runs; a whole run's is in ``run``, with the same equations.

What it does and the air around it come in from outside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ambient_trainer.simulator.device import Bursts, Device, Zone
from ambient_trainer.simulator.heat import Demand
from ambient_trainer.simulator.run import bursts, stream
from ambient_trainer.simulator.stepper import Stepper

_STEP_S = 1.0
_BLOCK = 3600


class LiveDevice:
    """The device with its ``zones``, settled in the air of ``start_s`` while it does ``activity``.

    The noise of ``seed`` counts from ``start_s``, bursts from ``recording_s`` later, as in a scenario with that much
    before its recording.
    """

    def __init__(
        self,
        device: Device,
        zones: Sequence[Zone],
        air_degC: Callable[[float], float],
        start_s: float,
        activity: str,
        seed: int = 0,
        recording_s: float = 0.0,
    ) -> None:
        self._device, self._air_degC, self._start_s = device, air_degC, start_s
        self._seed, self._recording_s = seed, recording_s
        self._stepper = Stepper([device], zones, _STEP_S)
        self._noise = [stream(seed, f"zone {zone.name}") for zone in zones]
        self._seconds = 0
        self._burst_block = np.ones(0)
        demand = self._stepper.balance.demand(np.array([device.activity_index([activity])]), np.ones(1))
        self._stepper.start(np.array([air_degC(start_s)]), demand)
        self._read(demand)

    @property
    def next_s(self) -> float:
        """When its next second is over."""
        return self._start_s + (self._seconds + 1) * _STEP_S

    def advance(self, now_s: float, activity: str) -> None:
        """Bring it to the last whole second before ``now_s``; what it does not know, it does not do."""
        index = self._device.activity_index([activity] if activity in self._device.activities else [])
        while self.next_s <= now_s:
            self._step(index)

    @property
    def battery_degC(self) -> float:
        """The battery's temperature."""
        assert self._device.battery
        return float(self._stepper.nodes_degC[0, self._device.index(self._device.battery.node)])

    @property
    def battery_V(self) -> float:
        """The battery's voltage, with the drop in its own resistance."""
        assert self._device.battery
        return self._device.battery.volt_V + self.current_A * self._device.battery.ohm

    def _step(self, activity: int) -> None:
        swing = tuple(self._device.activities.values())[activity].bursts
        demand = self._stepper.balance.demand(np.array([activity]), np.array([self._burst(swing) if swing else 1.0]))
        at_s = self.next_s - _STEP_S
        self._stepper.step(demand, (np.array([self._air_degC(at_s)]), np.array([self._air_degC(at_s + _STEP_S)])))
        self._read(demand)
        self._seconds += 1

    def _read(self, demand: Demand) -> None:
        self.current_A = float(self._stepper.balance.drawn(self._stepper.nodes_degC, demand)[1][0])
        """Into the battery."""
        noise = np.array([[random.standard_normal() for random in self._noise]])
        self.zones_degC: list[float] = self._stepper.readings_degC(noise)[0].tolist()
        """What the zones report."""

    def _burst(self, swing: Bursts) -> float:
        place = self._seconds % _BLOCK
        if place == 0 or not len(self._burst_block):
            first = self._seconds - place - self._recording_s
            self._burst_block = bursts(first + np.arange(_BLOCK, dtype=np.float64), swing, stream(self._seed, "bursts"))
        return float(self._burst_block[place])
