"""Circuits side by side: each fitted to the same samples, each scored on the same samples that none of them saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_trainer.data.trace import Trace, load_trace
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import Effort, Fit
from ambient_trainer.estimators.model_file import model_of, training_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.evaluation.evaluate import Evaluation, evaluate_file, evaluate_file_run_in
from ambient_trainer.report.table import Table

_COLUMNS = ("circuit", "sensors", "states", "training", "held out", "static", "cold start", "converged", "identifiable")
_CAPTION = (
    "RMSE in degC. Held out: samples that no fit saw, the estimate running since the first sample. Static: the same "
    "samples by a static linear formula of the same sensors. Cold start: the same samples, started from equilibrium "
    "at the first of them."
)


@dataclass(frozen=True)
class Contender:
    """A fitted circuit, its model, and its scores on held-out samples."""

    fit: Fit
    model: Model
    running: Evaluation
    cold: Evaluation


@dataclass(frozen=True)
class Contest:
    """What every contender is fitted to, and how its model is scored: (running, from a cold start)."""

    training: tuple[Trace, ...]
    to_s: float | None
    score: Callable[[Model], tuple[Evaluation, Evaluation]]

    @property
    def samples(self) -> int:
        """The number of training samples."""
        return sum(len(trace.time_s) for trace in self.training)


def split_contest(path: str, split_s: float) -> Contest:
    """Fit to the trace before ``split_s``, score on the rest of it."""
    trace = load_trace(path)
    first_s, last_s = trace.time_s[0], trace.time_s[-1]
    if not first_s < split_s <= last_s:
        problem = f"{split_s:g} s leaves nothing on one side of {path} ({first_s:g} to {last_s:g} s)"
        raise refuse("--split", "", problem, "choose a time in between")

    def score(model: Model) -> tuple[Evaluation, Evaluation]:
        return evaluate_file_run_in(model, path, split_s, None), evaluate_file(model, path, split_s, None)

    return Contest((trace.cut(None, split_s),), split_s, score)


def held_out_contest(training_paths: Sequence[str], held_out_path: str) -> Contest:
    """Fit to whole traces, score on another one, which starts cold."""

    def score(model: Model) -> tuple[Evaluation, Evaluation]:
        found = evaluate_file(model, held_out_path, None, None)
        return found, found

    return Contest(tuple(load_trace(path) for path in training_paths), None, score)


def contend(name: str, contest: Contest, sensors: Sequence[str], effort: Effort, progress: Progress) -> Contender:
    """Fit the circuit called ``name`` and score it; ``sensors`` (trace columns) are for those that read any."""
    method = estimator(name)
    fit = method.fit(contest.training, effort, progress, inputs=sensors if method.reads_any else None)
    provenance = [training_of(trace, None, contest.to_s) for trace in contest.training]
    model = model_of(fit, provenance, {})
    running, cold = contest.score(model)
    return Contender(fit, model, running, cold)


def comparison_table(contenders: Sequence[Contender]) -> Table:
    """One row a contender, best last."""
    ranked = sorted(contenders, key=lambda each: -each.running.metrics.rmse_degC)
    return Table(_CAPTION, _COLUMNS, tuple(_row(each) for each in ranked))


def as_json(contenders: Sequence[Contender]) -> dict[str, Any]:
    """The content of ``compare --json``."""
    return {"contenders": [_data(each) for each in contenders]}


def _row(each: Contender) -> tuple[str, ...]:
    baseline = each.running.baseline
    scores = (each.running.metrics, baseline and baseline.metrics, each.cold.metrics)
    figures = (each.fit.rmse_degC, *(score.rmse_degC if score else None for score in scores))
    shown = ("-" if figure is None else f"{figure:.2f}" for figure in figures)
    facts = ("yes" if fact else "no" for fact in (each.fit.converged, each.fit.identifiable))
    return (each.fit.circuit, str(len(each.fit.inputs)), str(len(each.fit.states)), *shown, *facts)


def _data(each: Contender) -> dict[str, Any]:
    baseline = each.running.baseline
    return {
        "circuit": each.fit.circuit,
        "inputs": list(each.fit.inputs),
        "states": len(each.fit.states),
        "training_rmse_degC": each.fit.rmse_degC,
        "held_out_rmse_degC": each.running.metrics.rmse_degC,
        "held_out_mae_degC": each.running.metrics.mae_degC,
        "held_out_samples": each.running.metrics.samples,
        "cold_start_rmse_degC": each.cold.metrics.rmse_degC,
        "static_linear_held_out_rmse_degC": baseline and baseline.metrics.rmse_degC,
        "converged": each.fit.converged,
        "identifiable": each.fit.identifiable,
    }
