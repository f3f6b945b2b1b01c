"""The result of a diagnosis: steps, each with a cause and its gain on data that it was not fitted to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array

NONE = "none"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Cause:
    """What is missing, where, and what drives it.

    Parameters
    ----------
    name : str
        A kind of cause, such as ``heat_source``, or ``unknown``, or ``none``.
    location : str, tuple of str, or None
        A node, ``a-b`` for two, a sensor, several that share one mechanism, or None for everywhere.
    signal : str or None
        The trace column that drives it; None where nothing logged does.
    """

    name: str
    location: str | tuple[str, ...] | None = None
    signal: str | None = None

    @property
    def place(self) -> str | None:
        """The location in one piece of text."""
        return self.location if self.location is None or isinstance(self.location, str) else ", ".join(self.location)

    def __str__(self) -> str:
        where = "" if self.location is None else f" at {self.place}"
        return f"{self.name}{where}" + ("" if self.signal is None else f" by {self.signal}")


@dataclass(frozen=True)
class Magnitude:
    """How large an effect is.

    Parameters
    ----------
    value : float
        In ``unit``.
    unit : str
        Of the value; ``1`` where it has none.
    meaning : str
        What the number is, in words.
    ci95 : tuple of float
        The 95 % interval.
    qualifier : str
        A clause on how it varies; empty where it does not.
    """

    value: float
    unit: str
    meaning: str
    ci95: tuple[float, float]
    qualifier: str = ""


@dataclass(frozen=True)
class Gain:
    """What a cause gains on held-out blocks of time.

    Parameters
    ----------
    rmse_before_degC, rmse_after_degC : float
        Root mean square over all sensors of the simulation's error, without and with the cause.
    ci95_degC : tuple of float
        The 95 % interval of their difference, by resampling blocks.
    p_value : float
        That of the gain, corrected for the candidates that were tried.
    """

    rmse_before_degC: float
    rmse_after_degC: float
    ci95_degC: tuple[float, float]
    p_value: float


@dataclass(frozen=True)
class Step:
    """One effect that was selected.

    Parameters
    ----------
    cause : Cause
        What it is.
    onset_s, end_s : float or None
        In the trace's time; None where it lasts from the trace's start, or to its end.
    magnitude : Magnitude or None
        How large it is; None for ``unknown``.
    confidence : float
        1 less the probability that chance, or the closest rival, explains the data as well.
    gain : Gain
        On held-out data, beside the steps before.
    indistinguishable_from : tuple of Cause
        Causes that explain the data as well.
    sentence : str
        All of that in a sentence.
    parameters : mapping of str to (float, str)
        Every number of the effect by name, with its unit.
    residual_degC : array, shape (sensors, samples)
        Measured minus simulated with this and all earlier steps, on ``Diagnosis.time_s``.
    """

    cause: Cause
    onset_s: float | None
    end_s: float | None
    magnitude: Magnitude | None
    confidence: float
    gain: Gain
    indistinguishable_from: tuple[Cause, ...]
    sentence: str
    parameters: Mapping[str, tuple[float, str]]
    residual_degC: Array


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
    """Where the circuit and the measurement part, on ``Diagnosis.time_s``.

    Parameters
    ----------
    sensors : tuple of str
        Names of the s rows of each array.
    measured_degC, simulated_degC : array, shape (s, samples)
        NaN where nothing was measured.
    heat : array, shape (s, samples)
        The heat into each sensor's node that would explain the residual, in ``heat_unit``.
    heat_unit : str
        ``W`` where a logged power sets the scale, else ``K/s``.
    tests : tuple of Tested
        Of the residual.
    ambient_error_degC : array, shape (samples,), or None
        Of the same circuit read backward, sensors in and ambient out: true minus estimate; None where it cannot be.
    """

    sensors: tuple[str, ...]
    measured_degC: Array
    simulated_degC: Array
    heat: Array
    heat_unit: str
    tests: tuple[Tested, ...]
    ambient_error_degC: Array | None = None

    @property
    def residual_degC(self) -> Array:
        """Measured minus simulated, (s, samples)."""
        return self.measured_degC - self.simulated_degC


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of traces: their misfit with the circuit, and the steps that explain it.

    Parameters
    ----------
    trace, circuit : str
        What was diagnosed, by which circuit.
    baselines : tuple of str
        Known-good traces; empty where there are none.
    time_s : array, shape (samples,)
        Of the longest record.
    signals : mapping of str to array
        The logged signals and the ambient on ``time_s``, by column.
    misfit : Misfit
        Of the circuit without any step.
    steps : tuple of Step
        In the order of their selection; a single ``unknown`` where the misfit is significant and not explained.
    verdict : Step or None
        The first step; None where nothing is missing.
    ranking : tuple of Ranked
        The candidates for the first step that were simulated, best first.
    next_experiment : str
        What to do to distinguish what these data do not.
    extended : Circuit or None
        The circuit with every step that a circuit can hold; None where none can.
    candidates_tried : int
        Candidates and windows of the first step.
    notes : sequence of str
        What the extended circuit leaves out, and why.
    fitted : Circuit or None
        The bare circuit with its parameters as fitted.
    bare_degC : float
        The held-out error of the circuit by itself.
    floor_degC : float or None
        What a black box with the same inputs leaves on held-out data; None with known-good records.
    explained_share : float or None
        Of what can be explained, the part that the steps explain; None where nothing can.
    """

    trace: str
    circuit: str
    baselines: tuple[str, ...]
    time_s: Array
    signals: Mapping[str, Array]
    misfit: Misfit
    steps: tuple[Step, ...]
    verdict: Step | None
    ranking: tuple[Ranked, ...]
    next_experiment: str
    extended: Circuit | None
    candidates_tried: int
    bare_degC: float
    notes: Sequence[str] = field(default_factory=tuple)
    fitted: Circuit | None = None
    floor_degC: float | None = None
    explained_share: float | None = None

    @property
    def explained(self) -> tuple[Step, ...]:
        """The steps that name a cause."""
        return tuple(step for step in self.steps if step.cause.name != UNKNOWN)

    @property
    def verdict_cause(self) -> Cause:
        """The verdict's cause; ``none`` where nothing is missing."""
        return self.verdict.cause if self.verdict else Cause(NONE)
