"""Sensor faults: offset, gain, lag, drift and a stuck reading of a sensor, and a clock offset."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.mechanisms import InProportion
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number, window
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.lti.lag import lagged

_HOUR_S = 3600.0
_MOST_OFF_DEGC = 10.0
"""Of a reference: what is further off measures something else."""
_RIGHT_DEGC = 25.0
"""Where a thermistor's resistance is given, from which its slope departs."""


class _Fault(InProportion):
    """What a sensor reads is off within a window."""

    instrument = True

    def apply(self, network: Network, values: Array, record: Record) -> None:
        sensors = [network.sensors.index(each) for each in self.places]
        weight = window(record, self.onset_s, self.end_s)

        def reading(read: Array) -> None:
            for sensor, value in zip(sensors, values.T):
                read[:, sensor] += weight * self.error(read[:, sensor], value[:, None], record)

        network.readings.append(reading)

    def error(self, own: Array, value: Array, record: Record) -> Array:
        """By how much it is off (P, N) where it should read ``own`` (P, N); ``value`` (P, 1) is its number."""
        raise NotImplementedError


@dataclass(frozen=True)
class Bias(_Fault):
    """An offset; ``sudden`` where it has to begin and end with a step."""

    sudden: bool = False

    cause = "sensor_bias"
    noun = "a sensor offset"

    @property
    def step_like(self) -> bool:
        return self.sudden

    def error(self, own: Array, value: Array, record: Record) -> Array:
        return value


@dataclass(frozen=True)
class Gain(_Fault):
    """It reads too much in proportion."""

    middle_degC: float = _RIGHT_DEGC

    cause = "sensor_gain"
    noun = "a sensor gain error"

    def error(self, own: Array, value: Array, record: Record) -> Array:
        return np.asarray(value * (own - self.middle_degC))


@dataclass(frozen=True)
class Drift(_Fault):
    """It reads ever more."""

    begin_s: float = 0.0

    may_end = False
    cause = "sensor_drift"
    noun = "sensor drift"

    def error(self, own: Array, value: Array, record: Record) -> Array:
        begin_s = self.begin_s if self.onset_s is None else self.onset_s
        return np.asarray(value * (record.time_s - begin_s) / _HOUR_S)


@dataclass(frozen=True)
class Lag(_Fault):
    """It follows with a lag."""

    cause = "sensor_lag"
    noun = "sensor lag"

    def error(self, own: Array, value: Array, record: Record) -> Array:
        behind = [lagged(row, float(lag), record.period_s) if lag > 0 else row for row, lag in zip(own, value[:, 0])]
        return np.asarray(behind - own)


class _OfReference(InProportion):
    """The ambient is another than its reference says."""

    def apply(self, network: Network, values: Array, record: Record) -> None:
        air = network.boundary(*(self.places or (AMBIENT,)))
        logged = network.boundary_degC[air]
        apart = np.array([self.ambient(logged, each, record.period_s) for each in values[:, 0]]) - logged
        network.flows.append((np.arange(len(network.nodes)), network.loss[:, :, air, None] * apart[:, None]))

    def ambient(self, logged: Array, off: float, period_s: float) -> Array:
        """The ambient (N,) where the reference, which is ``off`` by its number, has ``logged`` (N,)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Clock(_OfReference):
    """The reference's clock is ahead of the device's by so much: its true value comes later in the log."""

    cause = "clock_offset"
    noun = "a clock offset between the reference and the device"
    instrument = of_reference = multistart = True

    def ambient(self, logged: Array, off: float, period_s: float) -> Array:
        place = np.arange(len(logged), dtype=float)
        return np.interp(place + off / period_s, place, logged)


@dataclass(frozen=True)
class ReferenceLag(_OfReference):
    """The reference follows the ambient with a lag: T_ambient = T_reference + lag dT_reference/dt."""

    cause = "sensor_lag"
    noun = "lag of the reference"
    instrument = of_reference = True

    def ambient(self, logged: Array, off: float, period_s: float) -> Array:
        return np.asarray(logged + off / period_s * np.gradient(logged))

    def meaning(self, number: Number) -> str:
        return "lag of the reference"


@dataclass(frozen=True)
class ReferenceBias(_OfReference):
    """The reference reads too much: what heats or cools all nodes alike, as the sky does, is one with it."""

    cause = "sensor_bias"
    noun = "an offset of the reference"
    assumes = 1.0
    ambiguous = structural = True

    def ambient(self, logged: Array, off: float, period_s: float) -> Array:
        return logged - off

    def meaning(self, number: Number) -> str:
        return "offset of the reference"


@dataclass(frozen=True)
class Stuck(_Fault):
    """It reads the same whatever happens."""

    cause = "sensor_stuck"
    noun = "a stuck sensor"
    visible_in_readings = multistart = True

    def error(self, own: Array, value: Array, record: Record) -> Array:
        return np.asarray(value - own)

    def probes(self) -> Sequence[Sequence[float]]:
        return [[self.numbers[0].value]]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        return self


def alone(context: Context) -> Iterator[Mechanism]:
    """Without known-good records: a reading that jumps and jumps back, or is off ever more from some time on."""
    for each in context.sensors:
        yield from (replace(_bias((each,)), sudden=True), _drift(context, each))


def begun(context: Context) -> Iterator[Mechanism]:
    """A sensor that had been good is off, has another gain, drifts or lags."""
    return (each for sensor in context.sensors for each in (_bias((sensor,)), *_slow_faults(context, sensor)))


def _bias(sensors: tuple[str, ...]) -> Bias:
    return Bias(sensors, tuple(Number(f"bias_{each}", "degC", 0.0) for each in sensors))


def _drift(context: Context, sensor: str) -> Mechanism:
    number = Number(f"drift_{sensor}", "K/h", 0.0, scale=_HOUR_S / context.duration_s)
    return Drift((sensor,), (number,), begin_s=float(context.records[0].time_s[0]))


def _slow_faults(context: Context, sensor: str) -> Iterator[Mechanism]:
    place, span_s = (sensor,), context.duration_s
    gain = Number(f"gain_{sensor}", "1", 0.0, scale=0.01, low=-0.5, high=0.5)
    # without known-good records constant heat takes up what a wrong slope does at the mean
    for middle_degC in (context.mean_degC(sensor), *([_RIGHT_DEGC] if context.records[0].known_good else [])):
        yield Gain(place, (gain,), middle_degC=middle_degC)
    yield _drift(context, sensor)
    # what a long lag does is not in proportion to what a short one does
    for scale_s in (context.period_s / 2, 5 * context.period_s, 20 * context.period_s):
        yield Lag(place, (Number(f"lag_{sensor}", "s", 0.0, scale=scale_s, low=0.0, high=span_s / 20),))


def candidates(context: Context) -> Iterator[Mechanism]:
    """Each fault at each sensor, offsets of all, which constant heat in all their nodes looks like, and the clock."""
    for sensor in context.sensors:
        still = context.still(sensor)
        if still is not None:
            value, onset_s, end_s = still
            yield Stuck((sensor,), (Number(f"stuck_{sensor}", "degC", value),), None, onset_s, end_s)
        yield from _slow_faults(context, sensor)
    for sensors in context.groups(context.sensors):
        yield _bias(sensors)
    limit = context.duration_s / 12
    if context.ambient_varies:
        yield Clock((), (Number("clock", "s", 0.0, scale=context.period_s / 2, low=-limit, high=limit),))
        lag = Number("lag_ambient", "s", 0.0, scale=context.period_s, low=0.0, high=3 * limit)
        yield ReferenceLag((AMBIENT,), (lag,))
        # at one node alone constant heat, and its own sensor's offset, do the same
        if sum(context.loss(each) > 0 for each in context.nodes) > 1:
            off = Number("bias_ambient", "degC", 0.0, low=-_MOST_OFF_DEGC, high=_MOST_OFF_DEGC)
            yield ReferenceBias((AMBIENT,), (off,))
