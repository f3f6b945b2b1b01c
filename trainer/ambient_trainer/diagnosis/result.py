"""What a diagnosis says: steps, each with a cause and what it gains on data that it was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import Circuit

Array = NDArray[np.float64]

NONE = "none"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Cause:
    """What is missing: one of the contract's causes, where, and the logged signal that drives it.

    ``location`` is a node, ``a-b`` of two, a sensor, or None for everywhere; ``signal`` is a trace column or None.
    """

    name: str
    location: str | None = None
    signal: str | None = None

    def __str__(self) -> str:
        where = "" if self.location is None else f" at {self.location}"
        return f"{self.name}{where}" + ("" if self.signal is None else f" by {self.signal}")


@dataclass(frozen=True)
class Magnitude:
    """How large it is, in ``unit``, with its 95 % interval; ``meaning`` says what the number is.

    ``qualifier`` is a clause on how it varies, empty where it does not.
    """

    value: float
    unit: str
    meaning: str
    ci95: tuple[float, float]
    qualifier: str = ""


@dataclass(frozen=True)
class Gain:
    """The simulation's RMSE over all sensors on held-out blocks, without and with the cause, in degC.

    ``ci95_degC`` is the interval of their difference; ``p_value`` is corrected for the candidates that were tried.
    """

    rmse_before_degC: float
    rmse_after_degC: float
    ci95_degC: tuple[float, float]
    p_value: float


@dataclass(frozen=True)
class Step:
    """One effect found; ``onset_s`` and ``end_s`` are in the trace's time, None where it lasts from or to its ends.

    ``parameters`` holds every number of the extension by name, as (value, unit); ``residual_degC`` is what the
    simulation with this and all earlier steps leaves, shape (sensors, samples), on ``Diagnosis.time_s``.
    """

    cause: Cause
    onset_s: float | None
    end_s: float | None
    magnitude: Magnitude | None
    confidence: float
    """1 less the probability that chance, or the closest rival, explains the data as well."""
    gain: Gain
    indistinguishable_from: tuple[Cause, ...]
    sentence: str
    parameters: Mapping[str, tuple[float, str]]
    residual_degC: Array


@dataclass(frozen=True)
class Ranked:
    """A candidate that was tried for the first step, best first: its held-out gain and why it was not taken."""

    cause: Cause
    onset_s: float | None
    end_s: float | None
    magnitude: Magnitude | None
    gain: Gain
    remark: str


@dataclass(frozen=True)
class Tested:
    """One named test of a residual: its statistic against its threshold, and what that says."""

    name: str
    subject: str
    """The sensor, or the sensor and the signal."""
    statistic: float
    threshold: float
    significant: bool
    sentence: str


@dataclass(frozen=True)
class Misfit:
    """Where the circuit and the measurement part, one row a sensor, on ``Diagnosis.time_s``.

    ``heat`` is what would explain the residual at each node: in ``heat_unit``, which is W only where a logged power
    sets the scale, else K/s.
    """

    sensors: tuple[str, ...]
    measured_degC: Array
    simulated_degC: Array
    heat: Array
    heat_unit: str
    tests: tuple[Tested, ...]
    ambient_error_degC: Array | None = None
    """Of the same circuit read backward, sensors in and ambient out: true minus estimate; None where it can't be."""

    @property
    def residual_degC(self) -> Array:
        """Measured minus simulated."""
        return self.measured_degC - self.simulated_degC


@dataclass(frozen=True)
class Diagnosis:
    """All that is said of one trace: its misfit with the circuit, and the steps that explain it."""

    trace: str
    circuit: str
    baselines: tuple[str, ...]
    time_s: Array
    signals: Mapping[str, Array]
    """The logged signals and the ambient on ``time_s``, by column."""
    misfit: Misfit
    steps: tuple[Step, ...]
    verdict: Step | None
    """The first step, or None where nothing is missing; see ``verdict_cause``."""
    ranking: tuple[Ranked, ...]
    next_experiment: str
    extended: Circuit | None
    """The circuit with every step that a circuit can hold; None where none can."""
    candidates_tried: int
    notes: Sequence[str] = field(default_factory=tuple)

    @property
    def explained(self) -> tuple[Step, ...]:
        """The steps that name a cause."""
        return tuple(step for step in self.steps if step.cause.name != UNKNOWN)

    @property
    def verdict_cause(self) -> Cause:
        """``none`` where nothing is missing."""
        return self.verdict.cause if self.verdict else Cause(NONE)
