from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from ambient_trainer.laboratory.instruments import AIR, THERMOMETER_COLUMN, instrument, probe_column, settings
from ambient_trainer.laboratory.messages import Clock, InstrumentError

KINDS = {"chamber": "voetsch-vt4004", "multiplexer": "agilent-34970a", "thermometer": "greisinger-easybus"}
COLUMNS = {"chamber": AIR, "multiplexer": probe_column("air"), "thermometer": THERMOMETER_COLUMN}


def settings_of(role: str, port: str = "/nowhere/port", **values: Any) -> Any:
    if role == "multiplexer":
        values.setdefault("probes", {"air": 103, "wall": 101})
    return settings(KINDS[role], port=port, **values)


@pytest.fixture
def driver_at(driver_of) -> Callable[..., Any]:
    return lambda role, port="/nowhere/port", clock=None, **values: driver_of(settings_of(role, port, **values), clock)


class Bench(NamedTuple):
    """A driver and the simulated instrument at its port, in air of 21.5 degC."""

    role: str
    driver: Any
    simulated: Any
    clock: Clock

    def failure(self, error_type: type[InstrumentError] = InstrumentError) -> InstrumentError:
        """How a reading fails; the error names the instrument, its port, what was expected, and what came."""
        with pytest.raises(error_type) as caught:
            self.driver.read()
        error = caught.value
        assert (error.instrument, error.port) == (self.role, self.simulated.port)
        for part in (error.instrument, error.port, error.expected, error.got, error.hint):
            assert part in str(error)
        return error

    def reading(self) -> float:
        return self.driver.read().values[COLUMNS[self.role]]


@pytest.fixture
def bench(driver_at, closed) -> Callable[..., Bench]:
    def make(role: str, **values: Any) -> Bench:
        clock, simulated_class = Clock(20.0), instrument(KINDS[role]).Simulated
        if role == "chamber":
            simulated = simulated_class(settings_of(role), clock, 1)
            simulated.air.at = lambda at_s: 21.5
        elif role == "multiplexer":
            errors_K = {"air": 0.0, "wall": 0.1, "shelf": 0.2}
            named = settings_of(role, probes={"air": 103, "wall": 101, "shelf": 102})
            simulated = simulated_class(named, clock, lambda at_s: 21.5, 0, errors_K)
        else:
            simulated = simulated_class(settings_of(role), clock, lambda at_s: 21.5)
        return Bench(role, driver_at(role, closed(simulated).port, clock, **values), simulated, clock)

    return make
