"""The result of a search: the best set of sensors of each size, the best circuits, and their held-out errors.

How many sensors to take: the fewest within one standard error of the best (Breiman et al. 1984, *Classification and
Regression Trees*, section 3.4.3). The standard error is that of the mean square over the blocks.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.lti.statespace import Hold, StateSpace, dc_gain
from ambient_trainer.selection.screen import LeftOut, Sensor
from ambient_trainer.selection.topology import Topology

NEAR_DEGC = 0.02
"""Errors this close are as good as each other; chosen, a fifth of what a sensor may be off."""


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
class ScoredSystem:
    """A continuous system over trace columns and, per held-out block, sum (degC^2) and number of squared errors."""

    system: StateSpace
    hold: Hold
    columns: tuple[str, ...]
    squares: tuple[float, ...]
    samples: tuple[float, ...]

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

    def rmse_on(self, trace: Trace) -> float:
        """RMSE in degC on another trace, from a cold start at its first sample."""
        error = trace.reference - estimate_degC(self.system, self.hold, self.columns, trace)
        return float(np.sqrt(np.nanmean(error**2)))


@dataclass(frozen=True)
class Alternative:
    """The error when the sensor ``into`` replaces ``out`` is higher by ``worse_degC``."""

    out: str
    into: str
    worse_degC: float


@dataclass(frozen=True)
class SelectedSet:
    """The best set of sensors of a size, or one to compare with, by a filter over ``fixed`` poles and a ``free`` one.

    ``noise_gain`` is the estimate's standard deviation per unit of noise, ``noise_degC`` what the sensors' own makes.
    """

    sensors: tuple[str, ...]
    fixed: ScoredSystem
    noise_gain: float
    noise_degC: float
    free: ScoredSystem
    alternatives: tuple[Alternative, ...] = ()

    @property
    def rmse_degC(self) -> float:
        """Held-out RMSE of the filter over fixed poles."""
        return self.fixed.rmse_degC

    @property
    def dc_gains(self) -> tuple[float, ...]:
        """Of ``fixed``, one a sensor."""
        return tuple(dc_gain(self.fixed.system)[0].tolist())


@dataclass(frozen=True)
class SelectedCircuit:
    """The best circuit of a size, fitted to everything, and how many topologies of this size were ``tried``."""

    circuit: Circuit
    topology: Topology
    scored: ScoredSystem
    tried: int

    @property
    def rmse_degC(self) -> float:
        """Held-out RMSE."""
        return self.scored.rmse_degC


@dataclass(frozen=True)
class TraceScores:
    """RMSE in degC on a trace without a part in the selection, by number of sensors; ``against``: fixed, free poles."""

    path: str
    fixed: tuple[float, ...]
    free: tuple[float, ...]
    circuits: Mapping[int, float]
    against: tuple[float, float] | None

    @property
    def name(self) -> str:
        """The file's name without its folder and endings."""
        return os.path.basename(self.path).removesuffix(".gz").removesuffix(".csv")


@dataclass(frozen=True)
class SearchResult:
    """What :func:`ambient_trainer.selection.search.searched` returns.

    ``sizes`` and ``circuits`` go by number of sensors, from one; ``unnamed`` are those that a circuit file cannot name.
    """

    traces: tuple[str, ...]
    simulated: bool
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
    sizes: tuple[SelectedSet, ...]
    against: SelectedSet | None
    circuits: Mapping[int, SelectedCircuit]
    unnamed: tuple[str, ...]
    checks: tuple[TraceScores, ...]

    @property
    def recommended(self) -> SelectedSet:
        """The smallest set within one standard error of the best."""
        return self.sizes[fewest_within_one_error([each.fixed for each in self.sizes])]


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
