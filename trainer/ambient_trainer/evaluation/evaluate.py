"""Causal evaluation of a model: started from the first sensor sample, never from the reference, run as on a device.

Each sample is scored where there is both a reference and an estimate, the first minutes included; the others are
counted.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_model.model import Discrete, Input, Model
from ambient_model.observer import Observer
from ambient_model.trace import REFERENCE
from ambient_model.tracking import Tracker, bridge_limit_s, nearest_discrete
from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.estimators import STATIC_LINEAR, overlaps_training, provenance_of
from ambient_trainer.evaluation.metrics import Metrics, coverage, score, widened_coverage


@dataclass(frozen=True)
class Baseline:
    """The static linear estimate in degC, shape (n,), and its metrics over the samples that the model is scored on."""

    estimate_degC: Array
    metrics: Metrics


@dataclass(frozen=True)
class Evaluation:
    """A model's estimate over a trace of n samples and how wrong it is; arrays are of shape (n,), NaN where missing.

    ``low_degC`` and ``high_degC`` are the published 90 % interval, ``error_degC`` is reference minus estimate.
    ``coverage`` is the share of errors inside the model file's interval of each level in percent, and
    ``published_coverage`` that inside what a device publishes: wider where readings are refused, missing or coarse.
    """

    trace: str
    time_s: Array
    inputs: dict[Input, Array]
    """The sensors as logged."""
    estimate_degC: Array
    low_degC: Array
    high_degC: Array
    status: NDArray[np.str_]
    reference_degC: Array
    error_degC: Array
    metrics: Metrics
    coverage: dict[int, float]
    published_coverage: dict[int, float]
    trace_period_s: float
    period_s: float
    """The period of the recursion that ran."""
    baseline: Baseline | None
    overlaps_training: bool = False
    run_in: Metrics | None = None
    """Of a cold start in the middle of a trace: what the same samples score where the estimate ran before."""

    @property
    def by_method(self) -> dict[str, Metrics]:
        """The metrics of the model, of it run in, and of the static formula, as far as there are any."""
        static = self.baseline and self.baseline.metrics
        found = {"model": self.metrics, "model, run in": self.run_in, STATIC_LINEAR: static}
        return {method: each for method, each in found.items() if each}

    @property
    def without_estimate(self) -> int:
        """The number of samples without an estimate."""
        return int(np.count_nonzero(np.isnan(self.estimate_degC)))

    @property
    def without_reference(self) -> int:
        """The number of samples that have an estimate but no reference."""
        return int(np.count_nonzero(np.isfinite(self.estimate_degC) & np.isnan(self.reference_degC)))

    @property
    def scored(self) -> int:
        """The number of samples that the metrics are of."""
        return self.metrics.samples


class Tracked(NamedTuple):
    """What a device publishes, sample by sample: arrays (n,), of the readings that it uses (n, m); NaN for nothing."""

    ambient_degC: Array
    low_degC: Array
    high_degC: Array
    used: Array
    sigma_degC: Array
    status: NDArray[np.str_]


def evaluate_cold(model: Model, trace: Trace, from_s: float | None = None, to_s: float | None = None) -> Evaluation:
    """Evaluate ``model`` on ``trace`` between from_s and to_s, from a cold start at from_s.

    Also whether the model was trained on that, and what the same samples score run in. Raises :class:`Refused`.
    """
    scored = trace.cut(from_s, to_s)
    found = replace(evaluate_trace(model, scored), overlaps_training=overlaps_training(model, scored))
    if len(scored.time_s) and scored.time_s[0] > trace.time_s[0]:
        return replace(found, run_in=evaluate_run_in(model, trace, from_s, to_s).metrics)
    return found


def evaluate_run_in(model: Model, trace: Trace, from_s: float | None = None, to_s: float | None = None) -> Evaluation:
    """The same score between from_s and to_s, of an estimate that runs from the trace's first sensor sample on.

    A device that was on before publishes it: still causal, still without a look at the reference.
    """
    found = evaluate_trace(model, trace.cut(None, to_s), from_s)
    return replace(found, overlaps_training=overlaps_training(model, trace.cut(from_s, to_s)))


def evaluate_trace(model: Model, trace: Trace, from_s: float | None = None) -> Evaluation:
    """Run ``model`` over ``trace`` and score it from ``from_s`` on.

    Raises :class:`Refused` where a column or a score cannot be had.
    """
    wanted = (*(each.column for each in model.main.inputs), REFERENCE)
    if missing := [repr(name) for name in wanted if name not in trace.columns]:
        there = ", ".join(trace.columns) or "none"
        hint = f"it has {there}; log what the model reads and the reference, or map it on import"
        raise refuse(trace.path, "line 1", f"no column {', '.join(missing)}", hint)
    whole, trace = trace, trace.cut(from_s, None)
    trace_period_s = sampling_period_s(whole.time_s)
    discrete = nearest_discrete(model.main, trace_period_s)
    if trace_period_s > bridge_limit_s(discrete.period_s):
        bridged = f"the model at {discrete.period_s:g} s bridges at most {bridge_limit_s(discrete.period_s):g} s"
        problem = f"its samples lie {trace_period_s:g} s apart, and {bridged}"
        raise refuse(trace.path, "", problem, "log more often, or fit the model to a trace with this period")
    found = Tracked._make(each[-len(trace.time_s) :] for each in tracked(model, discrete, whole))
    error = trace.reference - found.ambient_degC
    scored = np.isfinite(error)
    if np.count_nonzero(scored) < 2:
        estimates_known, references = np.isfinite(found.ambient_degC).sum(), np.isfinite(trace.reference).sum()
        counts = f"{estimates_known} have an estimate, {references} a reference and {scored.sum()} both"
        problem = f"too few samples to score: of {len(trace.time_s)} samples {counts}"
        hint = "fill the columns, and see that the sensors lie within the ranges of the model file"
        raise refuse(trace.path, "", problem, f"two with both are wanted: {hint}")
    variance = model.error_variance
    interval = (model.main.interval, 1.0) if variance is None else (variance.quantiles, found.sigma_degC[scored])
    ends = np.stack([found.low_degC, found.high_degC]) - found.ambient_degC
    return Evaluation(
        trace=trace.path,
        time_s=trace.time_s,
        inputs={each: trace.columns[each.column] for each in model.main.inputs},
        estimate_degC=found.ambient_degC,
        low_degC=found.low_degC,
        high_degC=found.high_degC,
        status=found.status,
        reference_degC=trace.reference,
        error_degC=error,
        metrics=score(error[scored]),
        coverage=coverage(error[scored], *interval),
        published_coverage=widened_coverage(error[scored], ends[:, scored], *interval),
        trace_period_s=trace_period_s,
        period_s=discrete.period_s,
        baseline=_baseline(model, found.used, trace.reference, scored),
    )


def tracked(model: Model, discrete: Discrete, trace: Trace) -> Tracked:
    """What a device with ``model`` publishes over ``trace``, at the period of ``discrete``."""
    observer = Observer(model, Tracker(model.main, discrete))
    inputs = np.column_stack([trace.columns[each.column] for each in model.main.inputs])
    estimates, sigmas = [], []
    for now_s, row in zip(trace.time_s.tolist(), inputs.tolist()):
        estimates.append(observer.update(now_s, [None if value != value else value for value in row]))
        sigmas.append(observer.sigma_degC)
    ambient, low, high, status, used = zip(*estimates)
    numbers = (np.array(each, dtype=np.float64) for each in (ambient, low, high, used, sigmas))  # None becomes NaN
    return Tracked._make([*numbers, np.array(status)])


def _baseline(model: Model, used: Array, reference: Array, scored: NDArray[np.bool_]) -> Baseline | None:
    static = provenance_of(model).baseline
    if static is None:
        return None
    # from the inputs as the recursion took them: where one is held over a gap, both are scored on the same sample
    gains = np.array([static.gains.get(each.name, 0.0) for each in model.main.inputs])
    estimate = used @ gains + static.offset
    return Baseline(estimate, score((reference - estimate)[scored]))
