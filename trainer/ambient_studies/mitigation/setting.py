"""The settings of the comparison: rooms, what is the same for every row, and what a governor knows in each."""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data import Array
from ambient_trainer.lti import lagged
from ambient_trainer.simulator import Device, coloured, load_device

COLDEST_DEGC, HOTTEST_DEGC = -20.0, 60.0
_DOOR_S = 20.0  # time constant of the air around a phone that is carried into the next room; chosen
_DRAUGHT_DEGC = 0.2  # standard deviation of irregular air temperature; chosen
_DRAUGHT_S = 120.0  # correlation time of the irregular part; chosen


class Knowledge(Enum):
    """What a governor knows of the ambient."""

    NOTHING = "no governor"
    HOTTEST = "assumes the hottest"
    USUAL = "assumes the usual"
    ESTIMATE = "estimate"
    TRUTH = "true ambient"


@dataclass(frozen=True)
class Room:
    """Mixed air of one temperature, or of several through which a phone is carried, each for an equal time."""

    temps_degC: tuple[float, ...]

    @property
    def name(self) -> str:
        """Such as ``5`` or ``35/5/35``."""
        return "/".join(f"{each:g}" for each in self.temps_degC)

    def air_degC(self, idle: int, count: int, period_s: float, random: np.random.Generator) -> Array:
        """The air at each sample, shape (count,); the first ``idle`` samples are spent in the first room."""
        working = count - idle
        part = np.arange(working) * len(self.temps_degC) // working
        rooms = np.array(self.temps_degC)[np.concatenate([np.zeros(idle, dtype=np.intp), part])]
        return lagged(rooms, _DOOR_S, period_s) + _DRAUGHT_DEGC * coloured(count, period_s, _DRAUGHT_S, random)


def room_of(text: str) -> Room:
    """The room of a text such as ``5`` or ``35/5/35``; raises :class:`Refused`."""
    try:
        temps = tuple(float(each) for each in text.split("/"))
    except ValueError as error:
        raise refuse("--room", "", f"{text!r} is no temperature", "write 5, or 35/5/35 for a walk") from error
    if not all(COLDEST_DEGC <= each <= HOTTEST_DEGC for each in temps):
        problem = f"{text} lies outside {COLDEST_DEGC:g} to {HOTTEST_DEGC:g} degC"
        raise refuse("--room", "", problem, "choose temperatures in this range")
    return Room(temps)


@dataclass(frozen=True)
class Outage:
    """A sensor without readings from one minute of the work to another."""

    sensor: str
    from_min: float
    to_min: float


@dataclass(frozen=True)
class Setting:
    """The same for every row."""

    limit_degC: float = 40.0
    """The skin's highest permitted temperature."""
    hottest_degC: float = 35.0
    """The hottest room that the phone is made for; assumed without an estimate."""
    usual_degC: float = 20.0
    workload: str = "cpu_100"
    work_min: float = 60.0
    idle_min: float = 120.0
    """Before the work: the estimate settles."""
    period_s: float = 1.0
    convection_W_m2_K125: float | None = None
    """None: the calibrated one, of the chamber's moving air."""
    outage: Outage | None = None

    @property
    def phone(self) -> Device:
        """The calibrated phone, in this air."""
        if self.convection_W_m2_K125 is None:
            return load_device()
        return load_device().with_values({"convection_W_m2_K125": self.convection_W_m2_K125})

    @property
    def idle_samples(self) -> int:
        """Samples before the work; at least the one that starts in steady state."""
        return max(1, math.ceil(60 * self.idle_min / self.period_s))

    @property
    def samples(self) -> int:
        """Samples altogether."""
        return self.idle_samples + math.ceil(60 * self.work_min / self.period_s)


@dataclass(frozen=True)
class Case:
    """One simulated phone: its room, its noise and its governor's knowledge."""

    room: Room
    seed: int
    knowledge: Knowledge
