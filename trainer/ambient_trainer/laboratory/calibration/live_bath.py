"""Reference and probes are read side by side in a bath, real or simulated, until it has settled."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import pandas as pd

from ambient_trainer.laboratory.calibration.bath import (
    REFERENCE,
    Settled,
    last_window,
    not_settled,
    save_bath,
    unsettled,
)
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.instruments import (
    THERMOMETER_COLUMN,
    Driver,
    MultiplexerSettings,
    ThermometerSettings,
    instrument,
    probe_column,
)
from ambient_trainer.laboratory.reading import InstrumentError

BATHS_DEGC = (0.0, 20.0, 40.0, 60.0)
"""The temperatures to which the simulated bath goes, one after the other."""
SPEED = 100.0
_TIME_CONSTANT_S = 120.0  # chosen


class BathInstruments(NamedTuple):
    """The reference and the probes in one bath; ``go_to`` brings it to its temperature 0, 1, 2 and so on.

    ``errors_K`` is what the probes read too much, where that is known.
    """

    thermometer: Driver
    multiplexer: Driver
    probes: tuple[str, ...]
    clock: Clock
    go_to: Callable[[int], None]
    errors_K: Mapping[str, float] | None = None

    def identify(self) -> str:
        """The reference by its number; raises :class:`InstrumentError` where either instrument does not answer."""
        self.multiplexer.read()
        return self.thermometer.identify()


@contextlib.contextmanager
def real_bath(
    thermometer: ThermometerSettings, multiplexer: MultiplexerSettings, go_to: Callable[[int], None]
) -> Iterator[BathInstruments]:
    """Two instruments at their ports."""
    clock = Clock()
    with _drivers(thermometer, multiplexer, clock) as drivers:
        yield BathInstruments(*drivers, tuple(multiplexer.probes), clock, go_to)


class SimulatedBath:
    """A bath that starts at a room's temperature, and follows its set point as a first-order lag."""

    def __init__(self, clock: Clock, room_degC: float = 22.0) -> None:
        self._clock = clock
        self._since_s = clock.now_s()
        self._from_degC = self._to_degC = room_degC
        self._lock = threading.Lock()

    def go_to(self, temp_degC: float) -> None:
        """Go to ``temp_degC`` from now on."""
        now_s = self._clock.now_s()
        now_degC = self.at(now_s)
        with self._lock:
            self._since_s, self._from_degC, self._to_degC = now_s, now_degC, temp_degC

    def at(self, at_s: float) -> float:
        """Its temperature in degC at a time of the clock, no earlier than its newest set point."""
        with self._lock:
            left = math.exp(-max(at_s - self._since_s, 0.0) / _TIME_CONSTANT_S)
            return self._to_degC + (self._from_degC - self._to_degC) * left


@contextlib.contextmanager
def simulated_bath(
    thermometer: ThermometerSettings, multiplexer: MultiplexerSettings, seed: int = 0
) -> Iterator[BathInstruments]:
    """The same instruments simulated, :data:`SPEED` times as fast; their bath goes to :data:`BATHS_DEGC`."""
    clock = Clock(SPEED)
    with simulated_instruments(thermometer, multiplexer, clock, SimulatedBath(clock), seed) as instruments:
        yield instruments


@contextlib.contextmanager
def simulated_instruments(
    thermometer: ThermometerSettings, multiplexer: MultiplexerSettings, clock: Clock, bath: SimulatedBath, seed: int = 0
) -> Iterator[BathInstruments]:
    """Simulated instruments in ``bath``."""
    with contextlib.ExitStack() as stack:
        reference = instrument(thermometer.kind).Simulated(thermometer, clock, bath.at)
        stack.callback(reference.close)
        probes = instrument(multiplexer.kind).Simulated(multiplexer, clock, bath.at, seed)
        stack.callback(probes.close)
        at_ports = (
            thermometer.model_copy(update={"port": reference.port}),
            multiplexer.model_copy(update={"port": probes.port}),
        )
        drivers = stack.enter_context(_drivers(*at_ports, clock))
        names = tuple(multiplexer.probes)
        yield BathInstruments(*drivers, names, clock, lambda point: bath.go_to(BATHS_DEGC[point]), probes.errors_K)


@contextlib.contextmanager
def _drivers(
    thermometer: ThermometerSettings, multiplexer: MultiplexerSettings, clock: Clock
) -> Iterator[tuple[Driver, Driver]]:
    reference = instrument(thermometer.kind).Driver(thermometer, clock)
    probes = instrument(multiplexer.kind).Driver(multiplexer, clock)
    try:
        yield reference, probes
    finally:
        reference.close()
        probes.close()


class BathRecorder:
    """Reads the instruments every ``period_s``, and keeps all readings of one run; a bath has ``patience_s``."""

    def __init__(self, instruments: BathInstruments, period_s: float, patience_s: float) -> None:
        self._instruments = instruments
        self._period_s = period_s
        self._patience_s = patience_s
        self._clock = instruments.clock
        self._rows: dict[float, dict[str, float | None]] = {}
        self._began_s = self._clock.now_s()

    def record(self) -> pd.DataFrame:
        """What was read so far."""
        columns = {THERMOMETER_COLUMN: REFERENCE, **{probe_column(name): name for name in self._instruments.probes}}
        table = pd.DataFrame.from_dict(self._rows, orient="index", columns=list(columns), dtype=float)
        return table.rename(columns=columns)

    def windows(
        self, count: int, settled: Settled, show: Callable[[str], None], record_path: str | None
    ) -> list[pd.DataFrame]:
        """The settled window of each of ``count`` temperatures; all readings go to ``record_path``, also of a failure.

        ``show`` gets a line at each sample; for errors see :meth:`until_settled`.
        """
        found: list[pd.DataFrame] = []
        try:
            for point in range(count):
                self._instruments.go_to(point)
                head = f"bath {point + 1} of {count}"
                found.append(self.until_settled(settled, lambda text, head=head: show(f"{head}, {text}")))  # type: ignore[misc]
        finally:
            if record_path is not None:
                save_bath(self.record(), record_path)
        return found

    def until_settled(self, settled: Settled, show: Callable[[str], None]) -> pd.DataFrame:
        """The window in which the bath is settled; ``show`` gets its temperature at each sample, and what it lacks.

        Raises :class:`~ambient_model.faults.Refused` where patience ends, and an instrument's
        :class:`InstrumentError` where it did not answer in a whole window.
        """
        first, began_s = len(self._rows), self._clock.now_s()
        due_s = answered_s = began_s
        while True:
            failure = self._sample()
            window = last_window(self.record().iloc[first:], settled)
            reasons = unsettled(window, settled)
            lacking = "; ".join([str(failure), *reasons] if failure else reasons) or "settled"
            show(f"{window[REFERENCE].iloc[-1]:.2f} degC: {lacking}")
            if not reasons:
                return window
            now_s = self._clock.now_s()
            if failure is None:
                answered_s = now_s
            elif now_s - answered_s > settled.window_s:
                raise failure
            if now_s - began_s > self._patience_s:
                raise not_settled("the bath", reasons, settled)
            due_s = max(due_s + self._period_s, self._clock.now_s())
            self._clock.sleep(due_s - self._clock.now_s())

    def _sample(self) -> InstrumentError | None:
        """Read both; a failure is a missing value, and returned."""
        failure = None
        values: dict[str, float | None] = {}
        at_s = self._clock.now_s() - self._began_s
        for each in (self._instruments.thermometer, self._instruments.multiplexer):
            try:
                values.update(each.read().values)
            except InstrumentError as error:
                failure = error
        self._rows[at_s] = values
        return failure
