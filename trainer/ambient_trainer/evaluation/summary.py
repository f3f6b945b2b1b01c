"""The figures of an evaluation as the terminal, the page and a machine get them: the same numbers, put once."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambient_model.model import Model
from ambient_trainer.estimation.static_linear import STATIC_LINEAR
from ambient_trainer.evaluation.evaluate import Evaluation
from ambient_trainer.evaluation.metrics import Metrics
from ambient_trainer.report.table import Table

_COLUMNS = ("trace", "method", "RMSE", "MAE", "MBE", "98 % interval", "in 50/90/98 %", "samples")
_CAPTION = (
    "Errors in degC, true minus estimate. 98 % interval: mean ± 2.33 standard deviations of the errors. "
    "In 50/90/98 %: the percentage of errors inside the interval of that level that the model file publishes."
)


def as_json(model: Model, evaluations: Sequence[Evaluation]) -> dict[str, Any]:
    """The content of ``evaluate --json``."""
    return {"model": model.name, "traces": [_trace_data(each) for each in evaluations]}


def figures_table(evaluations: Sequence[Evaluation]) -> Table:
    """One row a trace and method."""
    rows: list[tuple[str, ...]] = []
    for label, each in zip(labels(evaluations), evaluations):
        trace = f"{label} (training data)" if each.overlaps_training else label
        shares = "/".join(f"{100 * share:.1f}" for share in each.coverage.values())
        rows.append((trace, "model", *_figures(each.metrics), shares, f"{each.scored:,}"))
        if each.run_in:
            rows.append((trace, "model, run in", *_figures(each.run_in), "-", f"{each.run_in.samples:,}"))
        if each.baseline:
            rows.append((trace, STATIC_LINEAR, *_figures(each.baseline.metrics), "-", f"{each.scored:,}"))
    return Table(_CAPTION, _COLUMNS, tuple(rows), labels=2)


def verdict(evaluations: Sequence[Evaluation]) -> str:
    """One sentence over all traces together, each sample counted once."""
    samples = sum(each.scored for each in evaluations)
    inside = sum(each.coverage[90] * each.scored for each in evaluations) / samples
    rmse = _pooled_rmse([each.metrics for each in evaluations])
    many = f"{len(evaluations)} traces" if len(evaluations) > 1 else "one trace"
    baselines = [each.baseline.metrics for each in evaluations if each.baseline]
    beside = f", where a static linear formula is {_pooled_rmse(baselines):.2f} degC off" if baselines else ""
    without = sum(each.without_estimate for each in evaluations)
    # a model that keeps silent where it would be wrong must not look good
    silent = f", and {without:,} more samples have no estimate" if without else ""
    return (
        f"Over {samples:,} samples of {many} the estimate is {rmse:.2f} degC "
        f"off (RMSE){beside}; the model's published 90 % interval holds {100 * inside:.1f} % of the errors"
        f"{silent}."
    )


def warnings(evaluations: Sequence[Evaluation]) -> list[str]:
    """What must be known before the figures are believed."""
    return [
        f"Not held out: the model was trained on samples of {label} that it is evaluated on here. These figures tell "
        "how well it remembers, not how well it predicts."
        for label, each in zip(labels(evaluations), evaluations)
        if each.overlaps_training
    ]


def labels(evaluations: Sequence[Evaluation]) -> list[str]:
    """A name for each trace: its file's, or the whole path where two files have the same name."""
    names = [os.path.basename(each.trace) for each in evaluations]
    return [name if names.count(name) == 1 else each.trace for name, each in zip(names, evaluations)]


def _figures(metrics: Metrics) -> tuple[str, ...]:
    low, high = metrics.interval_degC[98]
    return (
        f"{metrics.rmse_degC:.2f}",
        f"{metrics.mae_degC:.2f}",
        f"{metrics.mbe_degC:+.2f}",
        f"{low:+.2f} to {high:+.2f}",
    )


def _pooled_rmse(metrics: Sequence[Metrics]) -> float:
    squares = sum(each.samples * each.rmse_degC**2 for each in metrics)
    return float(np.sqrt(squares / sum(each.samples for each in metrics)))


def _trace_data(evaluation: Evaluation) -> dict[str, Any]:
    data = {
        "trace": evaluation.trace,
        **_metrics_data(evaluation.metrics),
        "coverage": {str(level): share for level, share in evaluation.coverage.items()},
        "unscored": evaluation.unscored,
        "without_estimate": evaluation.without_estimate,
        "without_reference": evaluation.without_reference,
        "status": dict(Counter(evaluation.status.tolist())),
        "trace_period_s": evaluation.trace_period_s,
        "period_s": evaluation.period_s,
        "overlaps_training": evaluation.overlaps_training,
    }
    if evaluation.run_in:
        data["run_in"] = _metrics_data(evaluation.run_in)
    if evaluation.baseline:
        data["baseline"] = {"kind": STATIC_LINEAR, **_metrics_data(evaluation.baseline.metrics)}
    return data


def _metrics_data(metrics: Metrics) -> dict[str, Any]:
    return {
        "samples": metrics.samples,
        "rmse_degC": metrics.rmse_degC,
        "mae_degC": metrics.mae_degC,
        "mbe_degC": metrics.mbe_degC,
        "interval_degC": {str(level): list(band) for level, band in metrics.interval_degC.items()},
    }
