"""Faults of an instrument: offset, gain, lag and drift of a sensor, and a clock that is off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number, window
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.lti.lag import lagged


@dataclass(frozen=True)
class _Linear(Mechanism):
    """One number, which acts in proportion."""

    instrument = True

    def sensor(self, network: Network) -> int:
        """The number of the sensor."""
        return network.sensors.index(self.places[0])

    def probes(self) -> Sequence[Sequence[float]]:
        return [[self.numbers[0].scale]]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        number = self.numbers[0]
        value = float(np.clip(amounts[0] * number.scale, number.low, number.high))
        return self.with_values([value]) if value else None


@dataclass(frozen=True)
class Bias(_Linear):
    """It reads too much by a constant."""

    cause = "sensor_bias"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        sensor, weight = self.sensor(network), window(record, self.onset_s, self.end_s)

        def reading(read: Array) -> None:
            read[:, sensor] += values[:, :1] * weight

        network.readings.append(reading)


@dataclass(frozen=True)
class Gain(_Linear):
    """It reads too much in proportion."""

    middle_degC: float = 25.0

    cause = "sensor_gain"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        sensor = self.sensor(network)

        def reading(read: Array) -> None:
            read[:, sensor] += values[:, :1] * (read[:, sensor] - self.middle_degC)

        network.readings.append(reading)


@dataclass(frozen=True)
class Drift(_Linear):
    """It reads ever more."""

    begin_s: float = 0.0

    cause = "sensor_drift"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        sensor, since = self.sensor(network), record.time_s - self.begin_s

        def reading(read: Array) -> None:
            read[:, sensor] += values[:, :1] * since

        network.readings.append(reading)


@dataclass(frozen=True)
class Lag(_Linear):
    """It follows with a lag."""

    cause = "sensor_lag"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        sensor = self.sensor(network)

        def reading(read: Array) -> None:
            for lane, lag in enumerate(values[:, 0]):
                if lag > 0:
                    read[lane, sensor] = lagged(read[lane, sensor], float(lag), record.period_s)

        network.readings.append(reading)


@dataclass(frozen=True)
class Clock(_Linear):
    """The reference's clock is ahead of the device's by so much: its true value comes later in the log."""

    cause = "clock_offset"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        air = network.boundary(AMBIENT)
        logged, place = network.boundary_degC[air], np.arange(record.samples, dtype=float)
        shifted = np.array([np.interp(place + shift, place, logged) for shift in values[:, 0] / record.period_s])
        network.heat += network.loss[:, :, air, None] * (shifted - logged)[:, None]


@dataclass(frozen=True)
class Stuck(_Linear):
    """It reads the same whatever happens."""

    cause = "sensor_stuck"
    evident = True
    shaped = True

    def apply(self, network: Network, values: Array, record: Record) -> None:
        sensor, weight = self.sensor(network), window(record, self.onset_s, self.end_s)

        def reading(read: Array) -> None:
            read[:, sensor] += weight * (values[:, :1] - read[:, sensor])

        network.readings.append(reading)

    def probes(self) -> Sequence[Sequence[float]]:
        return [[self.numbers[0].value]]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        return self


def windowed(scene: Scene) -> Iterator[Mechanism]:
    """A reading that is off for a while."""
    return (Bias((each,), (Number(f"bias_{each}", "K", 0.0),)) for each in scene.sensors)


def candidates(scene: Scene) -> Iterator[Mechanism]:
    """Each fault at each sensor, and the clock."""
    for sensor in scene.sensors:
        still = scene.still(sensor)
        if still is not None:
            value, onset_s, end_s = still
            yield Stuck((sensor,), (Number(f"stuck_{sensor}", "degC", value),), None, onset_s, end_s)
        yield Bias((sensor,), (Number(f"bias_{sensor}", "K", 0.0),))
        middle = scene.mean_degC(sensor)
        yield Gain((sensor,), (Number(f"gain_{sensor}", "1", 0.0, scale=0.01, low=-0.5, high=0.5),), middle_degC=middle)
        drift = Number(f"drift_{sensor}", "K/s", 0.0, scale=1.0 / scene.duration_s)
        yield Drift((sensor,), (drift,), begin_s=scene.begin_s)
        lag = Number(f"lag_{sensor}", "s", 0.0, scale=scene.period_s / 2, low=0.0, high=scene.duration_s / 20)
        yield Lag((sensor,), (lag,))
    limit = scene.duration_s / 20
    if scene.ambient_varies:
        yield Clock((), (Number("clock", "s", 0.0, scale=scene.period_s / 2, low=-limit, high=limit),))
