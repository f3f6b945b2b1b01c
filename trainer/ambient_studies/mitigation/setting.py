"""What every row of the comparison has in common, and what sets the rows apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from ambient_studies.mitigation.room import Room
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.device_file import load_device


class Told(Enum):
    """What a governor is told of the ambient."""

    NOTHING = "no governor"
    HOTTEST = "assumes the hottest"
    USUAL = "assumes the usual"
    ESTIMATE = "estimate"
    TRUTH = "true ambient"


@dataclass(frozen=True)
class Outage:
    """A sensor that is silent from one minute of the work to another."""

    sensor: str
    from_min: float
    to_min: float


@dataclass(frozen=True)
class Setting:
    """The same for every row."""

    limit_degC: float = 40.0
    """What the skin shall not pass."""
    hottest_degC: float = 35.0
    """The hottest room that the phone is made for: assumed by who knows no better."""
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
        """Before the work; at least the one in whose rest it starts."""
        return max(1, math.ceil(60 * self.idle_min / self.period_s))

    @property
    def samples(self) -> int:
        """All of them."""
        return self.idle_samples + math.ceil(60 * self.work_min / self.period_s)


@dataclass(frozen=True)
class Case:
    """One phone's way through a room."""

    room: Room
    seed: int
    told: Told
