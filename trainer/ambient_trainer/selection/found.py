"""What a search found, in the terms of those who read it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.lti.statespace import StateSpace
from ambient_trainer.selection.front import HeldOut
from ambient_trainer.selection.grams import Filter
from ambient_trainer.selection.screen import LeftOut, Sensor
from ambient_trainer.selection.wiring import Wiring


@dataclass(frozen=True)
class Options:
    """What is searched, and how; a state file belongs to one of these."""

    most: int = 6
    order: int = 4
    blocks: int = 10
    gap_s: float | None = None
    tolerance_degC: float = 0.1
    period_s: float | None = None


@dataclass(frozen=True)
class Alternative:
    """A sensor in place of another costs so much."""

    out: str
    into: str
    worse_degC: float


@dataclass(frozen=True)
class FreeFit:
    """The free filter whose poles were searched, too."""

    system: StateSpace
    columns: tuple[str, ...]
    held_out: HeldOut


@dataclass(frozen=True)
class Chosen:
    """The best set of a size, or one that was named."""

    sensors: tuple[str, ...]
    filter: Filter
    held_out: HeldOut
    noise_gain: float
    noise_degC: float
    """What the sensors' own noise makes in the estimate."""
    free: FreeFit
    alternatives: tuple[Alternative, ...]


@dataclass(frozen=True)
class FoundCircuit:
    """The best circuit of a size, its parameters as fitted to everything."""

    circuit: Circuit
    wiring: Wiring
    system: StateSpace
    held_out: HeldOut
    tried: int
    """Wirings of this size that were fitted."""


@dataclass(frozen=True)
class Check:
    """RMSE in degC on a trace that chose nothing, by number of sensors; ``against`` is that of the named set."""

    path: str
    filters: tuple[float, ...]
    free: tuple[float, ...]
    circuits: Mapping[int, float]
    against: tuple[float, float] | None
    """Of its filter and its free filter."""

    @property
    def name(self) -> str:
        """The file's name without its folder and endings."""
        return os.path.basename(self.path).removesuffix(".gz").removesuffix(".csv")


@dataclass(frozen=True)
class Found:
    """All of it."""

    traces: tuple[str, ...]
    simulated: bool
    """Whether any of them says so."""
    options: Options
    sensors: tuple[Sensor, ...]
    left_out: tuple[LeftOut, ...]
    period_s: float
    circuit_period_s: float
    poles_s: tuple[float, ...]
    blocks: int
    block_s: float
    gap_s: float
    sets_tried: int
    sizes: tuple[Chosen, ...]
    """By number of sensors, from one."""
    named: int
    """The place in ``sizes`` that the one-standard-error rule names."""
    against: Chosen | None
    circuits: Mapping[int, FoundCircuit]
    """By number of sensors."""
    unnamed: tuple[str, ...]
    """Sensors that no circuit file can name."""
    checks: tuple[Check, ...]
