"""The result of a diagnosis: steps, each with a cause and its gain on data that it was not fitted to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array

NONE = "none"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Cause:
    """What is missing, where, and what drives it."""

    name: str
    """A kind of cause, such as ``heat_source``, or ``unknown``, or ``none``."""
    location: str | tuple[str, ...] | None = None
    """A node, ``a-b`` for two, a sensor, several that share one mechanism, or None for everywhere."""
    signal: str | None = None
    """The trace column that drives it; None where nothing logged does."""

    @property
    def place(self) -> str | None:
        """The location in one piece of text."""
        return self.location if self.location is None or isinstance(self.location, str) else ", ".join(self.location)

    def __str__(self) -> str:
        where = "" if self.location is None else f" at {self.place}"
        return f"{self.name}{where}" + ("" if self.signal is None else f" by {self.signal}")


@dataclass(frozen=True)
class Magnitude:
    """How large an effect is: ``value`` in ``unit`` (``1`` where it has none), and its 95 % interval."""

    value: float
    unit: str
    meaning: str
    """What the number is, in words."""
    ci95: tuple[float, float]
    qualifier: str = ""
    """A clause on its scale and on how it varies; empty where neither needs one."""
    scale_known: bool = True
    """False where only the circuit's own capacitances set the scale of watts: no logged power does."""


@dataclass(frozen=True)
class Gain:
    """What a cause gains on held-out blocks of time.

    Errors are root mean squares over all sensors of the simulation's error, without and with the cause.
    """

    rmse_before_degC: float
    rmse_after_degC: float
    ci95_degC: tuple[float, float]
    """The 95 % interval of their difference, by resampling blocks."""
    p_value: float
    """That of the gain, corrected for the candidates that were tried."""


@dataclass(frozen=True)
class Step:
    """One effect that was selected: its cause, and what it gains beside the steps before."""

    cause: Cause
    onset_s: float | None
    """In the trace's time, as ``end_s``; None where it lasts from the trace's start."""
    end_s: float | None
    """None where it lasts to the trace's end."""
    magnitude: Magnitude | None
    """None for ``unknown``."""
    confidence: float
    """1 less the probability that chance, or the closest rival, explains the data as well."""
    gain: Gain
    indistinguishable_from: tuple[Cause, ...]
    """Causes that explain the data as well."""
    sentence: str
    """All of that in a sentence."""
    parameters: Mapping[str, tuple[float, str]]
    """Every number of the effect by name, with its unit."""
    residual_degC: Array
    """Measured minus simulated with this and all earlier steps, (sensors, samples), on ``Diagnosis.time_s``."""


@dataclass(frozen=True)
class Ranked:
    """A candidate for the first step: its held-out gain, and in ``remark`` why it was not selected."""

    cause: Cause
    onset_s: float | None
    end_s: float | None
    magnitude: Magnitude | None
    gain: Gain
    remark: str


@dataclass(frozen=True)
class Tested:
    """A test of a residual: its statistic against its threshold. ``subject`` is a sensor, or a sensor and a signal."""

    name: str
    subject: str
    statistic: float
    threshold: float
    significant: bool
    sentence: str

    @staticmethod
    def of(name: str, subject: str, if_significant: str, if_not: str, statistic: float, threshold: float) -> "Tested":
        """A test that says of its sensor one thing where it is significant, and another where not."""
        significant = bool(statistic > threshold)
        sentence = f"{subject.split(',')[0]}: {if_significant if significant else if_not}."
        return Tested(name, subject, float(statistic), float(threshold), significant, sentence)


@dataclass(frozen=True)
class Misfit:
    """Where the circuit and the measurement part, on ``Diagnosis.time_s``; arrays have a row for each of s sensors."""

    sensors: tuple[str, ...]
    measured_degC: Array
    """(s, samples), as ``simulated_degC``; NaN where nothing was measured."""
    simulated_degC: Array
    heat: Array
    """The heat into each sensor's node that would explain the residual, (s, samples), in ``heat_unit``."""
    heat_unit: str
    """``W`` where a logged power sets the scale, else ``K/s``."""
    tests: tuple[Tested, ...]
    """Of the residual."""
    ambient_error_degC: Array | None = None
    """True minus estimate, (samples,), of the same circuit read backward, sensors in and ambient out; None where it
    cannot be."""

    @property
    def residual_degC(self) -> Array:
        """Measured minus simulated, (s, samples)."""
        return self.measured_degC - self.simulated_degC


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of traces by a circuit: their misfit with it, and the steps that explain that."""

    trace: str
    circuit: str
    baselines: tuple[str, ...]
    """Known-good traces; empty where there are none."""
    time_s: Array
    """(samples,), of the longest record."""
    signals: Mapping[str, Array]
    """The logged signals and the ambient on ``time_s``, by column."""
    misfit: Misfit
    """Of the circuit without any step."""
    steps: tuple[Step, ...]
    """In the order of their selection; a single ``unknown`` where the misfit is significant and not explained."""
    verdict: Step | None
    """The first step; None where nothing is missing."""
    ranking: tuple[Ranked, ...]
    """The candidates for the first step that were simulated, best first."""
    next_experiment: str
    """What to do to distinguish what these data do not."""
    extended: Circuit | None
    """The circuit with every step that a circuit can hold; None where none can."""
    candidates_tried: int
    """Candidates and windows of the first step."""
    bare_degC: float
    """The held-out error of the circuit by itself."""
    notes: Sequence[str] = field(default_factory=tuple)
    """What the extended circuit leaves out, and why."""
    fitted: Circuit | None = None
    """The bare circuit with its parameters as fitted."""
    floor_degC: float | None = None
    """What a black box with the same inputs leaves on held-out data; None with known-good records."""
    explained_share: float | None = None
    """Of what can be explained, the part that the steps explain; None where nothing can."""

    @property
    def explained(self) -> tuple[Step, ...]:
        """The steps that name a cause."""
        return tuple(step for step in self.steps if step.cause.name != UNKNOWN)

    @property
    def verdict_cause(self) -> Cause:
        """The verdict's cause; ``none`` where nothing is missing."""
        return self.verdict.cause if self.verdict else Cause(NONE)
