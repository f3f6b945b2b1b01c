"""The contract of every estimator: fitted to traces it gives a discrete system, fallbacks and an interval."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.model import LEVELS_PERCENT, ErrorVariance, Quantiles
from ambient_model.trace import REFERENCE
from ambient_trainer.data import Array, Segment, Trace, sampling_period_s, segments
from ambient_trainer.data.trace import is_reference
from ambient_trainer.estimation import Budget, Progress, Structure
from ambient_trainer.estimators.estimate import blended, estimate_degC
from ambient_trainer.lti import Hold, StateSpace, dc_gain, discretised, response_degC

STATIC_LINEAR = "static linear"
"""What a model file calls it."""


class StaticLinear(NamedTuple):
    """ambient = gains' u + offset; ``rmse_degC`` on the samples it was fitted to."""

    gains: Array
    offset: float
    rmse_degC: float


def fit_static_linear(segments: Sequence[Segment]) -> StaticLinear:
    """The least-squares static map from the sensors to the first output over ``segments``."""
    u = np.concatenate([segment.inputs for segment in segments], axis=1)
    y = np.concatenate([segment.outputs[0] for segment in segments])
    known = ~np.isnan(y)
    table = np.column_stack([u[:, known].T, np.ones(int(known.sum()))])
    solution = np.linalg.lstsq(table, y[known], rcond=None)[0]
    errors = y[known] - table @ solution
    return StaticLinear(solution[:-1], float(solution[-1]), float(np.sqrt(np.mean(errors**2))))


LEFT_OUT = "Left out: "  # so begins a fit's note on columns that it does not read
_NO_SENSOR = 1e9
"""No quantity of a device is as large in any of a trace's units: such a value is an error code."""
_BRIDGED_S = 120.0
"""Chosen on simulated nights with gaps: over longer ones a straight line misses more than a start in equilibrium."""


def source_of(traces: Sequence[Trace]) -> str:
    """The traces' names, for a message."""
    return ", ".join(trace.path for trace in traces)


def temperature_columns(traces: Sequence[Trace]) -> tuple[str, ...]:
    """Every ``_degC`` column of the first trace but the references."""
    names = tuple(name for name in traces[0].columns if name.endswith("_degC") and not is_reference(name))
    if not names:
        raise refuse(traces[0].path, "line 1", "no '_degC' column besides the reference", "log a sensor")
    return names


def slowest_period_s(traces: Sequence[Trace]) -> float:
    """The longest of the traces' sampling periods."""
    return max(sampling_period_s(trace.time_s) for trace in traces)


def training_segments(
    traces: Sequence[Trace], inputs: Sequence[str], outputs: Sequence[str], period_s: float | None, pieces: int
) -> list[Segment]:
    """The grids that a fit works on, each trace in so many pieces; a filter of the reference bridges short gaps."""
    require_informative(traces, inputs, outputs)
    bridged_s = _BRIDGED_S if tuple(outputs) == (REFERENCE,) else 0.0
    whole = [segment for trace in traces for segment in segments(trace, inputs, outputs, period_s, bridged_s)]
    return [piece for segment in whole for piece in segment.pieces(pieces)]


class Training(NamedTuple):
    """What an estimator is fitted to: trace columns, the grids over them, and the traces themselves."""

    columns: tuple[str, ...]
    segments: Sequence[Segment]
    traces: Sequence[Trace]

    def without(self, dropped: int) -> Training:
        """The same without the input of that number."""
        kept = [index for index in range(len(self.columns)) if index != dropped]
        columns = tuple(self.columns[index] for index in kept)
        return Training(columns, [each.of(kept) for each in self.segments], self.traces)


def require_informative(traces: Sequence[Trace], inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Refuse traces that, taken together, hold no information on a column, naming every such column."""
    faults = []
    for name in dict.fromkeys((*inputs, *outputs)):
        known = np.concatenate([trace.column(name) for trace in traces])
        known = known[~np.isnan(known)]
        # an estimate needs inputs that change; a simulation may have a constant boundary, but no lone constant output
        must_change = tuple(outputs) in ((REFERENCE,), (name,))
        if name in inputs and name in outputs:
            faults.append(Fault(f"column {name}", "is what is to be estimated", "a device has no such sensor"))
        elif not len(known):
            faults.append(Fault(f"column {name}", "holds no value at all", "leave it out, or log it"))
        elif np.abs(known).max() > _NO_SENSOR:
            worst = known[np.abs(known).argmax()]
            faults.append(Fault(f"column {name}", f"holds {worst:g}", "no sensor reads that: leave such cells empty"))
        elif np.ptp(known) == 0 and must_change:
            hint = "leave out the sensor, it is stuck" if name in inputs else "log a run in which it changes"
            faults.append(Fault(f"column {name}", f"is {known[0]:g} all the time", hint))
    if faults:
        raise Refused(source_of(traces), faults)


def require_enough(traces: Sequence[Trace], structure: Structure) -> None:
    """Refuse traces with fewer samples than ``structure`` has unknowns."""
    samples = sum(int((~np.isnan(segment.outputs)).sum()) for segment in structure.segments)
    unknowns = len(structure.search.names) + len(structure.linear.names)
    if samples <= unknowns:
        problem = f"{samples} samples for {unknowns} unknowns"
        raise refuse(source_of(traces), "", problem, "log longer, or take a smaller circuit")


@dataclass(frozen=True)
class Effort:
    """How hard to search."""

    starts: int = 8
    """Searches from so many places; the first is the circuit's or the data's own."""
    seed: int = 0
    pieces: int = 1
    """A trace is fitted in so many, each from thermal equilibrium, which penalises gains that make starts absurd."""
    budget: Budget = field(default_factory=Budget, compare=False, repr=False)
    """What each search may spend; cancelled, all of them end."""
    first: int = 0
    """The number of the first search, where others make those before: of an estimator whose ``starts_apart``."""


USUAL = Effort()


class Estimator(ABC):
    """A method that can be fitted."""

    name: str
    """What a user calls it."""
    reads_any = True
    """Whether it reads whatever temperatures it is given; otherwise it names its own trace columns."""
    own_columns: Sequence[str] = ()
    """The trace columns that it names, where it does not read any."""
    starts_apart = False
    """Whether a fit is no more than its best search, so that several may make them and compare the ends."""

    def searches(self, effort: Effort) -> int:
        """How many searches a fit makes, for a progress bar: by default one a start."""
        return effort.starts

    def fit(
        self,
        traces: Sequence[Trace],
        effort: Effort = USUAL,
        progress: Progress | None = None,
        period_s: float | None = None,
        inputs: Sequence[str] | None = None,
    ) -> Fit:
        """Fit to traces of the sensors and the reference ``ambient_degC``, on the grid of :meth:`training`.

        ``inputs`` are trace columns, where it ``reads_any``. Raises :class:`Refused` where a column is missing or never
        changes, or the traces hold too little.
        """
        training = self.training(traces, inputs, period_s, effort.pieces)
        with threadpool_limits(1):
            fit = self.fit_to(training, effort, progress)
        further = [each for each in traces[0].columns if is_reference(each) and each != REFERENCE]
        if inputs or not further or not self.reads_any:
            return fit
        return replace(fit, notes=(*fit.notes, f"{LEFT_OUT}{', '.join(further)}: a further reference is no sensor."))

    def training(
        self, traces: Sequence[Trace], inputs: Sequence[str] | None, period_s: float | None, pieces: int
    ) -> Training:
        """What it is fitted to: by default every temperature, on the slowest trace's own grid."""
        columns, period = tuple(inputs or temperature_columns(traces)), period_s or slowest_period_s(traces)
        return Training(columns, training_segments(traces, columns, (REFERENCE,), period, pieces), traces)

    @abstractmethod
    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to this training data."""


class ParameterEstimate(NamedTuple):
    """One unknown: its value, standard error and 95 % interval (None where the data give none)."""

    name: str
    unit: str
    value: float
    standard_error: float | None
    interval95: tuple[float, float] | None
    free: bool
    at_bound: bool
    identifiable: bool


@dataclass(frozen=True)
class Fit:
    """The linear system of least error, its unknowns, and how far to trust them: it may predict well and be open.

    ``inputs`` are trace columns; ``errors_degC`` (true minus predicted) are of the training samples, one array an
    output. ``fallbacks`` do without an input, by its name in a model file. ``stopped`` is the best of a search that was
    ended. ``confounded`` and ``residual_memory_samples`` are those of :class:`Uncertainty`; ``notes`` are remarks of
    this kind of estimator, ``details`` the same as data, for ``fit --json`` and the file's provenance.
    """

    circuit: str
    system: StateSpace
    hold: Hold
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    periods_s: tuple[float, ...]
    parameters: tuple[ParameterEstimate, ...]
    converged: bool
    uncertainty_available: bool
    identifiable: bool
    stopped: bool
    confounded: tuple[tuple[str, ...], ...]
    residual_memory_samples: float
    rmse_degC: float
    start_rmses_degC: tuple[float, ...]
    evaluations: int
    effort: Effort
    errors_degC: tuple[Array, ...]
    baseline: StaticLinear
    input_ranges: tuple[tuple[float, float], ...]
    fallbacks: Mapping[str, Fit] = field(default_factory=dict)
    secondary: SecondaryFit | None = None
    error_variance: ErrorVariance | None = None
    notes: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """The number of reference samples it was fitted to."""
        return sum(len(each) for each in self.errors_degC)

    @property
    def dc_gains(self) -> tuple[float, ...]:
        """Per input the DC gain to the first output: D - C A^-1 B."""
        return tuple(dc_gain(self.system)[0].tolist())

    @property
    def interval_degC(self) -> Quantiles:
        """Per level in percent the training errors (true minus estimate) between which that share lies."""
        ends = [((100 - level) / 2, (100 + level) / 2) for level in LEVELS_PERCENT]
        return dict(zip(LEVELS_PERCENT, map(tuple, np.percentile(self.errors_degC[0], ends).tolist())))

    def discrete(self, period_s: float) -> StateSpace:
        """The recursion at ``period_s``, exact for the fit's hold."""
        return discretised(self.system, period_s, self.hold)

    def estimate_degC(self, trace: Trace) -> Array:
        """The estimate over ``trace``, shape (n,), blended with the secondary estimator's where there is one."""
        main = estimate_degC(self.system, self.hold, self.inputs, trace)
        if self.secondary is None:
            return main
        return blended(main, self.secondary.fit.estimate_degC(trace), self.secondary.threshold_degC).ambient_degC

    def over(self, segment: Segment) -> Array:
        """The estimate of its own system, (N,), over uniform samples."""
        return response_degC(self.system, self.hold, segment.inputs, segment.period_s)


class SecondaryFit(NamedTuple):
    """The secondary estimator of a fit, of the same inputs, and the difference from which on the two are blended."""

    fit: Fit
    threshold_degC: float
