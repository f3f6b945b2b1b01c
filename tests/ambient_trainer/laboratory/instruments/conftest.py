from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest

from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.simulated.chamber import SimulatedChamber
from ambient_trainer.laboratory.simulated.multiplexer import SimulatedMultiplexer
from ambient_trainer.laboratory.simulated.terminal import SimulatedInstrument
from ambient_trainer.laboratory.simulated.thermometer import SimulatedThermometer

SPEED = 20.0


class Bench(NamedTuple):
    """A driver and the simulated instrument at its port, which reads what ``air_degC`` says."""

    driver: Any
    simulated: Any
    clock: FastClock
    air_degC: list[float]
    """One number, to be changed."""

    def failure(self, error_type: type[LineError] = LineError) -> LineError:
        """How a reading fails; the error names the instrument, its port, what was expected, and what came."""
        with pytest.raises(error_type) as caught:
            self.driver.read()
        error = caught.value
        assert (error.instrument, error.port) == (self.driver.name, self.simulated.port)
        assert (
            str(error)
            == f"{error.instrument} on {error.port}: expected {error.expected}, got {error.got}; {error.mend}"
        )
        return error

    def reading(self) -> float:
        """The temperature that a reading holds."""
        got = self.driver.read()
        if isinstance(self.driver, Multiplexer):
            return got.temps_degC["air"]
        return got.actual_degC if isinstance(self.driver, Chamber) else got.temp_degC


@pytest.fixture
def clock() -> FastClock:
    return FastClock(SPEED)


@pytest.fixture
def bench(tmp_path, clock) -> Iterator[Callable[[str], Bench]]:
    """Makes a bench of a kind: ``chamber``, ``multiplexer`` or ``thermometer``."""
    made: list[Any] = []

    def make(kind: str) -> Bench:
        air_degC = [21.5]
        folder = str(tmp_path)
        simulated: SimulatedInstrument
        driver: Any
        if kind == "chamber":
            simulated = SimulatedChamber(clock, folder=folder, seed=1)
            simulated.air_degC = lambda at_s=None: air_degC[0]
            simulated._air.at = lambda at_s: air_degC[0]
            driver = Chamber(simulated.port, clock=clock)
        elif kind == "multiplexer":
            simulated = SimulatedMultiplexer(
                clock, lambda at_s: air_degC[0], channels=[101, 102, 103], folder=folder, errors_K={103: 0.0}
            )
            driver = Multiplexer(simulated.port, {"air": 103, "wall": 101}, clock=clock)
        else:
            simulated = SimulatedThermometer(clock, lambda at_s: air_degC[0], folder=folder)
            driver = Thermometer(simulated.port, clock=clock)
        made.extend((driver, simulated))
        return Bench(driver, simulated, clock, air_degC)

    yield make
    for each in made:
        each.close()
