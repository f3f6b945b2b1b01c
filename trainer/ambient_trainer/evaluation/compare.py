"""Comparison of estimators: each fitted to the same samples and scored on the same held-out samples."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators import Effort, Fit, estimator, model_of, reading_model, training_of
from ambient_trainer.estimators.base import LEFT_OUT
from ambient_trainer.evaluation.evaluate import Evaluation, evaluate_cold, evaluate_run_in
from ambient_trainer.report import Finding, Report, Section, Table

_COLUMNS = ("circuit", "sensors", "states", "training", "held out", "static", "cold start", "converged", "identifiable")
_CAPTION = (
    "RMSE in degC. Held out: samples that no fit saw, the estimate running since the first sample. Static: the same "
    "samples by a static linear formula of the same sensors. Cold start: the same samples, started from equilibrium "
    "at the first of them."
)


@dataclass(frozen=True)
class ScoredFit:
    """A fitted estimator, its model, and its scores on held-out samples."""

    fit: Fit
    model: Model
    running: Evaluation
    cold: Evaluation


@dataclass(frozen=True)
class Split:
    """What every contender is fitted to, and the trace that it is scored on from ``split_s`` on."""

    training: Sequence[Trace]
    held_out: Trace
    split_s: float | None = None

    @property
    def samples(self) -> int:
        """The number of training samples."""
        return sum(len(trace.time_s) for trace in self.training)


def split_at(trace: Trace, split_s: float) -> Split:
    """Fit to the trace before ``split_s``, score on the rest of it."""
    first_s, last_s = trace.time_s[0], trace.time_s[-1]
    if not first_s < split_s <= last_s:
        problem = f"{split_s:.10g} s leaves nothing on one side of {trace.path} ({first_s:.10g} to {last_s:.10g} s)"
        raise refuse("--split", "", problem, "choose a time in between")
    return Split([trace.cut(None, split_s)], trace, split_s)


def fit_and_score(name: str, split: Split, sensors: Sequence[str], effort: Effort, progress: Progress) -> ScoredFit:
    """Fit the estimator called ``name`` and score it; ``sensors`` (trace columns) are for those that read any."""
    method = estimator(name)
    fit = method.fit(split.training, effort, progress, inputs=sensors if method.reads_any else None)
    training = [training_of(trace, None, split.split_s) for trace in split.training]
    model = model_of(fit, training, {}, reading_model(fit, split.training))
    cold = evaluate_cold(model, split.held_out, split.split_s)
    running = cold if split.split_s is None else evaluate_run_in(model, split.held_out, split.split_s)
    return ScoredFit(fit, model, running, cold)


def report_of(estimators: Sequence[ScoredFit]) -> Report:
    """The report of a comparison, the best contender last."""
    ranked = sorted(estimators, key=lambda each: -each.running.metrics.rmse_degC)
    best = ranked[-1]
    left_out = dict.fromkeys(note for each in estimators for note in each.fit.notes if note.startswith(LEFT_OUT))
    stopped = f"Stopped: of {estimators[-1].fit.circuit} this is the best so far; what comes after was not fitted."
    return Report(
        subject="Comparison",
        title=f"{best.fit.circuit}: {best.running.metrics.rmse_degC:.2f} degC (RMSE) on held-out samples",
        lead=[Finding(stopped, "warning") if estimators[-1].fit.stopped else None, *map(Finding, left_out)],
        sections=[Section("", [Table(_CAPTION, _COLUMNS, [_row(each) for each in ranked])])],
        data={"contenders": [_data(each) for each in estimators]},
    )


def _row(each: ScoredFit) -> tuple[str, ...]:
    data = _data(each)
    keys = ("training_rmse", "held_out_rmse", "static_linear_held_out_rmse", "cold_start_rmse")
    rmses = (data[f"{key}_degC"] for key in keys)
    shown = ("-" if rmse is None else f"{rmse:.2f}" for rmse in rmses)
    facts = ("yes" if data[fact] else "no" for fact in ("converged", "identifiable"))
    return (each.fit.circuit, str(len(each.fit.inputs)), str(len(each.fit.states)), *shown, *facts)


def _data(each: ScoredFit) -> dict[str, Any]:
    baseline, metrics = each.running.baseline, each.running.metrics
    return {
        "circuit": each.fit.circuit,
        "inputs": list(each.fit.inputs),
        "states": len(each.fit.states),
        "training_rmse_degC": each.fit.rmse_degC,
        "held_out_rmse_degC": metrics.rmse_degC,
        "held_out_mae_degC": metrics.mae_degC,
        "held_out_samples": metrics.samples,
        "cold_start_rmse_degC": each.cold.metrics.rmse_degC,
        "static_linear_held_out_rmse_degC": baseline and baseline.metrics.rmse_degC,
        "converged": each.fit.converged,
        "identifiable": each.fit.identifiable,
    }
