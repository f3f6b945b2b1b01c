"""A fit: traces and a structure go in; a system comes out, with what the data do and do not say about it.

"Converged", "uncertainty available" and "identifiable" are three facts. A fit may predict well and be none of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.model import Spread
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.grid import Segment, sampling_period_s, segments
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.budget import Budget
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.free_start import FreelyStartingCircuit
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimation.static_linear import StaticLinear, fit_static_linear
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.uncertainty import Uncertainty, residuals, uncertainty
from ambient_trainer.lti.statespace import Hold, StateSpace

Array = NDArray[np.float64]


_NO_SENSOR = 1e9
_TELLS_NOTHING = float(np.log(1e3))
"""Half a 95 % interval, as a logarithm, from which on it says no more than that the parameter is positive."""


@dataclass(frozen=True)
class Effort:
    """How to search: from how many places, the seed of all but the first, and in how many pieces a trace is fitted.

    Each piece starts from thermal equilibrium, as a device does that is switched on. One piece fits best what a
    device says that has long been on; several keep a circuit from gains that make every start absurd.
    """

    starts: int = 8
    seed: int = 0
    pieces: int = 1
    budget: Budget = field(default_factory=Budget, compare=False, repr=False)
    """What each search may spend, and the token that cancels all of them."""


@dataclass(frozen=True)
class Estimated:
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
    """The best system found, its unknowns, and how far to trust them.

    ``inputs`` are trace columns; ``errors_degC`` (true minus predicted) are those of the training samples, one array
    an output.
    """

    circuit: str
    system: StateSpace
    hold: Hold
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    periods_s: tuple[float, ...]
    """Of the traces it was fitted to, shortest first."""
    parameters: tuple[Estimated, ...]
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
    """Per input (its name in a model file) the fit that does without it."""
    spread: Spread | None = None
    """How wrong to think the estimate just now."""
    guard: GuardFit | None = None
    notes: tuple[str, ...] = ()
    """What else there is to say of it, a line each."""
    figures: Mapping[str, Any] = field(default_factory=dict)
    """What a recipe of its own has to tell, for the file's provenance and for a machine."""

    @property
    def dc_gains(self) -> tuple[float, ...]:
        """Per input the gain to the first output at rest: D - C A^-1 B."""
        at_rest = self.system.D - self.system.C @ np.linalg.solve(self.system.A, self.system.B)
        return tuple(at_rest[0].tolist())

    @property
    def samples(self) -> int:
        """The number of reference samples it was fitted to."""
        return sum(len(each) for each in self.errors_degC)


class GuardFit(NamedTuple):
    """The guard of a fit, of the same inputs, and how far the two may part before it has a say."""

    fit: Fit
    threshold_degC: float


def free_order(name: str) -> int | None:
    """N of ``free-N``, N from 1 to 4; None for any other name."""
    found = re.fullmatch(r"free-([1-4])", name)
    return int(found[1]) if found else None


def temperature_columns(traces: Sequence[Trace]) -> tuple[str, ...]:
    """Every ``_degC`` column of the first trace but the reference: what ``free-N`` reads."""
    names = tuple(name for name in traces[0].columns if name.endswith("_degC") and name != REFERENCE)
    if not names:
        raise refuse(traces[0].path, "line 1", "no '_degC' column besides the reference", "log a sensor")
    return names


def fit_circuit(
    circuit: Circuit,
    traces: Sequence[Trace],
    effort: Effort,
    progress: Progress | None = None,
    period_s: float | None = None,
) -> Fit:
    """Fit ``circuit`` to one or several traces, each stretch from thermal equilibrium with its first sample.

    Raises :class:`Refused` where the traces lack a column, hold too little, or an input never changes.
    """
    columns = tuple(output.column for output in circuit.outputs)
    data = training_segments(traces, circuit.inputs, columns, period_s, effort.pieces)
    estimates_ambient = columns == (REFERENCE,)
    structure = (CircuitStructure if estimates_ambient else FreelyStartingCircuit)(circuit, data)
    require_enough(traces, structure)
    with threadpool_limits(1):
        found = searched(structure, effort, progress)
        best = found.result.best
        values = structure.values(best.theta, best.beta)
        units = {each.name: each.unit for each in circuit.parameters}
        logarithmic = structure.logarithmic_names
        # what the file gives as a bare number has a place for a name, with dots in it
        shown = [each.name for each in circuit.parameters if each.free or "." not in each.name]
        return fit_of(
            found,
            structure.system(best.theta, best.beta),
            tuple(estimated(name, units[name], values[name], name in logarithmic, found.known) for name in shown),
            circuit=circuit.name,
            hold=circuit.hold,
            inputs=circuit.inputs,
            states=tuple(node.name for node in circuit.states),
            outputs=tuple(output.name for output in circuit.outputs),
        )


def fit_free_filter(
    order: int,
    traces: Sequence[Trace],
    effort: Effort,
    progress: Progress | None = None,
    period_s: float | None = None,
    inputs: Sequence[str] | None = None,
) -> Fit:
    """Fit the free linear filter of ``order`` over ``inputs`` (trace columns; by default every temperature)."""
    columns, segments = estimator_data(traces, inputs, period_s, effort.pieces)
    structure = FreeFilter(order, segments)
    require_enough(traces, structure)
    with threadpool_limits(1):
        found = searched(structure, effort, progress)
        best = found.result.best
        poles = zip(structure.search.names, np.exp(best.theta).tolist())
        return fit_of(
            found,
            structure.system(best.theta, best.beta),
            tuple(estimated(name, "1" if "zeta" in name else "1/s", value, True, found.known) for name, value in poles),
            circuit=f"free-{order}",
            hold="first-order",
            inputs=columns,
            states=tuple(f"mode{index + 1}" for index in range(order)),
            outputs=("ambient",),
        )


class Found(NamedTuple):
    """What a search ended with, in the structure's own terms."""

    structure: Structure
    result: SearchResult
    known: Uncertainty
    effort: Effort


def searched(structure: Structure, effort: Effort, progress: Progress | None) -> Found:
    """Search, and ask how well what was found is known."""
    result = search(structure, effort.starts, effort.seed, progress, effort.budget)
    return Found(structure, result, uncertainty(structure, result.best), effort)


def fit_of(
    found: Found,
    system: StateSpace,
    parameters: tuple[Estimated, ...],
    *,
    circuit: str,
    hold: Hold,
    inputs: tuple[str, ...],
    states: tuple[str, ...],
    outputs: tuple[str, ...],
) -> Fit:
    """The fit of what was found: ``system`` and ``parameters`` are the structure's, in the user's terms."""
    structure, result, known, effort = found
    per_segment = residuals(structure, result.best)
    errors = [np.concatenate([each[output] for each in per_segment]) for output in range(len(outputs))]
    errors = [each[~np.isnan(each)] for each in errors]
    count = sum(len(each) for each in errors)
    free = [each for each in parameters if each.free]
    told = [each for each in free if each.identifiable and not each.at_bound]
    u = np.concatenate([segment.inputs for segment in structure.segments], axis=1)
    return Fit(
        circuit=circuit,
        system=system,
        hold=hold,
        inputs=inputs,
        states=states,
        outputs=outputs,
        periods_s=tuple(sorted({segment.period_s for segment in structure.segments})),
        parameters=parameters,
        converged=result.best.converged and not result.stopped,
        uncertainty_available=bool(told) and all(each.interval95 is not None for each in told),
        identifiable=bool(known.identifiable.all()) and all(each.identifiable for each in free),
        stopped=result.stopped,
        confounded=known.confounded,
        residual_memory_samples=known.residual_memory_samples,
        rmse_degC=float(np.sqrt(result.best.sum_of_squares / count)),
        start_rmses_degC=tuple(float(np.sqrt(each.sum_of_squares / count)) for each in result.starts),
        effort=effort,
        evaluations=result.evaluations,
        errors_degC=tuple(errors),
        baseline=fit_static_linear(structure.segments),
        input_ranges=tuple((float(row.min()), float(row.max())) for row in u),
    )


def estimated(name: str, unit: str, value: float, logarithmic: bool, known: Uncertainty) -> Estimated:
    """One unknown of a fit; ``logarithmic`` where it was searched as a logarithm."""
    if name not in known.names:
        return Estimated(name, unit, value, None, None, free=False, at_bound=False, identifiable=True)
    index = known.names.index(name)
    error = float(known.standard_error[index])
    bound, told = bool(known.at_bound[index]), bool(known.identifiable[index])
    if np.isnan(error):
        return Estimated(name, unit, value, None, None, True, bound, told)
    half = known.quantile * error
    if logarithmic and half > _TELLS_NOTHING:
        return Estimated(name, unit, value, None, None, True, bound, identifiable=False)
    if logarithmic:
        spread = float(np.exp(half))
        return Estimated(name, unit, value, value * error, (value / spread, value * spread), True, bound, told)
    return Estimated(name, unit, value, error, (value - half, value + half), True, bound, told)


def training_segments(
    traces: Sequence[Trace], inputs: Sequence[str], outputs: Sequence[str], period_s: float | None, pieces: int
) -> list[Segment]:
    """The grids that a fit works on, each trace in so many pieces; refuses what :func:`refuse_untaught` does."""
    refuse_untaught(traces, inputs, outputs)
    whole = [segment for trace in traces for segment in segments(trace, inputs, outputs, period_s)]
    return [piece for segment in whole for piece in segment.pieces(pieces)]


def estimator_data(
    traces: Sequence[Trace], inputs: Sequence[str] | None, period_s: float | None, pieces: int
) -> tuple[tuple[str, ...], list[Segment]]:
    """The columns that an estimator of the reference reads, and its grids.

    Without ``inputs`` they are every temperature, without ``period_s`` the grid is the slowest trace's own.
    """
    columns = tuple(inputs or temperature_columns(traces))
    period = period_s or max(sampling_period_s(trace.time_s) for trace in traces)
    return columns, training_segments(traces, columns, (REFERENCE,), period, pieces)


def refuse_untaught(traces: Sequence[Trace], inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Refuse traces from which, taken together, nothing can be learned of a column, naming every such column."""
    faults = []
    for name in (*inputs, *outputs):
        known = np.concatenate([trace.column(name) for trace in traces])
        known = known[~np.isnan(known)]
        if not len(known):
            faults.append(Fault(f"column {name}", "holds no value at all", "leave it out, or log it"))
        elif np.abs(known).max() > _NO_SENSOR:
            worst = known[np.abs(known).argmax()]
            faults.append(Fault(f"column {name}", f"holds {worst:g}", "no sensor reads that: leave such cells empty"))
        elif np.ptp(known) == 0 and _must_move(name, outputs):
            mend = "a stuck sensor teaches nothing: leave it out" if name in inputs else "log a run in which it changes"
            faults.append(Fault(f"column {name}", f"is {known[0]:g} all the time", mend))
    if faults:
        raise Refused(", ".join(trace.path for trace in traces), faults)


def _must_move(name: str, outputs: Sequence[str]) -> bool:
    """An estimate needs inputs that move; a simulation may have a constant boundary, but no lone constant output."""
    return tuple(outputs) == (REFERENCE,) or tuple(outputs) == (name,)


def require_enough(traces: Sequence[Trace], structure: Structure) -> None:
    """Refuse traces with fewer samples than ``structure`` has unknowns."""
    samples = sum(int((~np.isnan(segment.outputs)).sum()) for segment in structure.segments)
    unknowns = len(structure.search.names) + len(structure.linear.names)
    if samples <= unknowns:
        source = ", ".join(trace.path for trace in traces)
        raise refuse(source, "", f"{samples} samples for {unknowns} unknowns", "log longer, or take a smaller circuit")
