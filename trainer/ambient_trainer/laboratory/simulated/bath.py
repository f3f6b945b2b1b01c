"""A simulated stirred bath, with a simulated thermometer and simulated probes in it."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator

from ambient_trainer.laboratory.clock import Clock, FastClock
from ambient_trainer.laboratory.instruments.bath_run import BathLab
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.simulated.multiplexer import SimulatedMultiplexer
from ambient_trainer.laboratory.simulated.thermometer import SimulatedThermometer

BATHS_DEGC = (0.0, 20.0, 40.0, 60.0)
SPEED = 100.0

_PROBES = {"air1": 101, "air2": 102, "air3": 103, "air4": 104}
_INERTIA_S = 120.0  # chosen


class SimulatedBath:
    """A bath that starts at a room's temperature."""

    def __init__(self, clock: Clock, room_degC: float = 22.0) -> None:
        self._clock = clock
        self._since_s = clock.now_s()
        self._from_degC = self._to_degC = room_degC
        self._lock = threading.Lock()

    def go(self, temp_degC: float) -> None:
        """Go to ``temp_degC`` from now on."""
        now_s = self._clock.now_s()
        now_degC = self.at(now_s)
        with self._lock:
            self._since_s, self._from_degC, self._to_degC = now_s, now_degC, temp_degC

    def at(self, at_s: float) -> float:
        """Its temperature in degC at a time of the clock that is not before what was last asked of it."""
        with self._lock:
            left = math.exp(-max(at_s - self._since_s, 0.0) / _INERTIA_S)
            return self._to_degC + (self._from_degC - self._to_degC) * left


@contextlib.contextmanager
def simulated_bath(seed: int = 0) -> Iterator[BathLab]:
    """The laboratory for a calibration, :data:`SPEED` times as fast as a real one; it goes to :data:`BATHS_DEGC`."""
    clock = FastClock(SPEED)
    bath = SimulatedBath(clock)
    with contextlib.ExitStack() as stack:
        far_thermometer = SimulatedThermometer(clock, bath.at)
        stack.callback(far_thermometer.close)
        far_multiplexer = SimulatedMultiplexer(clock, bath.at, channels=list(_PROBES.values()), seed=seed)
        stack.callback(far_multiplexer.close)
        thermometer = Thermometer(far_thermometer.port, clock=clock)
        stack.callback(thermometer.close)
        multiplexer = Multiplexer(far_multiplexer.port, _PROBES, clock=clock)
        stack.callback(multiplexer.close)
        errors_K = {name: far_multiplexer.error_K(channel) for name, channel in _PROBES.items()}
        yield BathLab(
            thermometer, multiplexer, tuple(_PROBES), clock, lambda point: bath.go(BATHS_DEGC[point]), errors_K
        )
