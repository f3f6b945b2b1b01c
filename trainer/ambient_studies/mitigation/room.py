"""Where a phone is: in one room, or walking from one into the next; the air of each is mixed, not still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_trainer.lti import lagged
from ambient_trainer.simulator.chamber import coloured

Array = NDArray[np.float64]

COLDEST_DEGC, HOTTEST_DEGC = -20.0, 60.0
_DOOR_S = 20.0  # how long the air about a phone takes to be the next room's; chosen
_DRAUGHT_DEGC = 0.2  # standard deviation of what is irregular; chosen
_DRAUGHT_S = 120.0  # how long a draught lasts; chosen


@dataclass(frozen=True)
class Room:
    """The temperatures that a phone comes through, each for an equal part of the time."""

    temps_degC: tuple[float, ...]

    @property
    def name(self) -> str:
        """Such as ``5`` or ``35/5/35``."""
        return "/".join(f"{each:g}" for each in self.temps_degC)

    def air_degC(self, idle: int, count: int, period_s: float, random: np.random.Generator) -> Array:
        """The air at each sample, shape (count,); the first ``idle`` of them lie in the first room and do not count."""
        working = count - idle
        part = np.arange(working) * len(self.temps_degC) // working
        rooms = np.array(self.temps_degC)[np.concatenate([np.zeros(idle, dtype=np.intp), part])]
        return lagged(rooms, _DOOR_S, period_s) + _DRAUGHT_DEGC * coloured(count, period_s, _DRAUGHT_S, random)


def room_of(text: str) -> Room:
    """The room that ``5`` or ``35/5/35`` stands for; raises :class:`Refused`."""
    try:
        temps = tuple(float(each) for each in text.split("/"))
    except ValueError as error:
        raise refuse("--room", "", f"{text!r} is no temperature", "write 5, or 35/5/35 for a walk") from error
    if not all(COLDEST_DEGC <= each <= HOTTEST_DEGC for each in temps):
        problem = f"{text} lies outside {COLDEST_DEGC:g} to {HOTTEST_DEGC:g} degC"
        raise refuse("--room", "", problem, "nobody works there: choose others")
    return Room(temps)
