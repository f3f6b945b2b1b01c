"""What is searched, and the result: the best set of sensors of each size, the best circuits, their held-out errors.

How many sensors to take: the fewest within one standard error of the best (Breiman et al. 1984, *Classification and
Regression Trees*, section 3.4.3). The standard error is that of the mean square over the blocks.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data import Segment, Trace
from ambient_trainer.estimation.validation import Block
from ambient_trainer.lti.statespace import StateSpace, dc_gain
from ambient_trainer.selection.screen import Sensor
from ambient_trainer.selection.topology import Topology

NEAR_DEGC = 0.02
"""Errors this close are as good as each other; chosen, a fifth of what a sensor may be off."""
_CIRCUIT_SAMPLES = 10_000


@dataclass(frozen=True)
class Options:
    """What to search, and how; a state file belongs to one of these."""

    most: int = 6
    order: int = 4
    blocks: int = 10
    gap_s: float | None = None
    tolerance_degC: float = 0.1
    period_s: float | None = None


@dataclass(frozen=True)
class SearchData:
    """The traces on one grid, what may be chosen from them, and how; ``left_out`` says why a column may not."""

    traces: tuple[Trace, ...]
    sensors: tuple[Sensor, ...]
    left_out: Mapping[str, str]
    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    options: Options

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return tuple(each.name for each in self.sensors)

    @property
    def period_s(self) -> float:
        """Period of the grid."""
        return self.segments[0].period_s

    @property
    def simulated(self) -> bool:
        """Whether any of the traces says so."""
        return any(each.notes.get("simulated") == "yes" for each in self.traces)

    @property
    def circuit_period_s(self) -> float:
        """A multiple of the period that leaves no more samples than hundreds of circuits can be fitted to."""
        return self.period_s * math.ceil(sum(each.inputs.shape[1] for each in self.segments) / _CIRCUIT_SAMPLES)


@dataclass(frozen=True)
class ScoredSystem:
    """A continuous system with sum (degC^2) and number of squared errors of each held-out block.

    ``checks_degC`` are its RMSE on each trace without a part in the selection, from a cold start at the first sample.
    """

    system: StateSpace
    squares: tuple[float, ...]
    samples: tuple[float, ...]
    checks_degC: tuple[float, ...]

    @property
    def mean_square(self) -> float:
        """Over all held-out samples, in degC^2."""
        return sum(self.squares) / sum(self.samples)

    @property
    def rmse_degC(self) -> float:
        """The root of :attr:`mean_square`."""
        return float(np.sqrt(self.mean_square))

    @property
    def standard_error_degC2(self) -> float:
        """Standard error of the mean square, from its differences between blocks."""
        each = np.asarray(self.squares) / np.asarray(self.samples)
        return float(np.std(each, ddof=1) / np.sqrt(len(each)))

    @property
    def interval_degC(self) -> tuple[float, float]:
        """The RMSE one standard error down and up."""
        middle, error = self.mean_square, self.standard_error_degC2
        return float(np.sqrt(max(middle - error, 0.0))), float(np.sqrt(middle + error))


@dataclass(frozen=True)
class Alternative:
    """The error when the sensor ``into`` replaces ``out`` is higher by ``worse_degC``."""

    out: str
    into: str
    worse_degC: float


@dataclass(frozen=True)
class SelectedSet(ScoredSystem):
    """The best set of sensors of a size, or one to compare with, by a filter over fixed poles and a ``free`` one.

    ``noise_gain`` is the estimate's standard deviation per unit of noise, ``noise_degC`` what the sensors' own makes.
    """

    sensors: tuple[str, ...]
    noise_gain: float
    noise_degC: float
    free: ScoredSystem
    alternatives: tuple[Alternative, ...] = ()

    @property
    def dc_gains(self) -> tuple[float, ...]:
        """One a sensor."""
        return tuple(dc_gain(self.system)[0].tolist())


@dataclass(frozen=True)
class SelectedCircuit(ScoredSystem):
    """The best circuit of a size, fitted to everything, and how many topologies of this size were ``tried``."""

    circuit: Circuit
    topology: Topology
    tried: int


@dataclass(frozen=True)
class SearchResult:
    """What :func:`ambient_trainer.selection.search.searched` returns.

    ``sizes`` and ``circuits`` go by number of sensors, from one; ``unnamed`` are those that a circuit file cannot name.
    ``checks`` are the paths of the traces without a part in the selection.
    """

    data: SearchData
    poles_s: tuple[float, ...]
    sets_tried: int
    sizes: tuple[SelectedSet, ...]
    against: SelectedSet | None
    circuits: Mapping[int, SelectedCircuit]
    unnamed: tuple[str, ...]
    checks: tuple[str, ...]

    @property
    def sets(self) -> list[SelectedSet]:
        """Those of each size, and the one to compare with."""
        return [*self.sizes, *([self.against] if self.against else [])]

    @property
    def recommended(self) -> SelectedSet:
        """The smallest set within one standard error of the best."""
        return self.sizes[fewest_within_one_error(self.sizes)]


def counted(sensors: int) -> str:
    """A number of sensors in words."""
    return f"{sensors} sensor{'s' * (sensors > 1)}"


def pareto_front(errors: Sequence[float]) -> list[int]:
    """The places whose error is below that of all before them."""
    return [index for index, error in enumerate(errors) if all(error < other for other in errors[:index])]


def fewest_within_one_error(sizes: Sequence[ScoredSystem]) -> int:
    """The first place whose mean square is at most the least one plus its standard error."""
    best = min(sizes, key=lambda each: each.mean_square)
    limit = best.mean_square + best.standard_error_degC2
    return next(index for index, each in enumerate(sizes) if each.mean_square <= limit)


def flat_from(errors: Sequence[float], gain_degC: float) -> int:
    """The first place after which no error is lower by more than ``gain_degC``."""
    return next(index for index, error in enumerate(errors) if error - min(errors[index:]) <= gain_degC)
