"""The report of an evaluation: a model's errors on traces beside the static formula's, and every sample as a plot."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from ambient_model.model import Model
from ambient_model.tracking import COASTING, DEGRADED, FAULTED, WARMING_UP
from ambient_trainer.data.units import written
from ambient_trainer.estimators import STATIC_LINEAR, provenance_of
from ambient_trainer.evaluation.evaluate import Evaluation
from ambient_trainer.evaluation.metrics import ROLLING_LEVEL_PERCENT, ROLLING_SAMPLES, Metrics, rolling_band
from ambient_trainer.report import Facts, Figure, Finding, Plot, Report, Section, Table, palette, plots

_COLUMNS = ("trace", "method", "RMSE", "MAE", "MBE", "98 % interval", "in 50/90/98 %", "samples")
_CAPTION = (
    "Errors in degC, true minus estimate. 98 % interval: mean ± 2.33 standard deviations of the errors. "
    "In 50/90/98 %: the percentage of errors inside a device's interval of that level, widened where it lacks readings."
)
_SEEN = (
    "Not held out: the model was trained on samples of {} that it is evaluated on here. The figures are no measure of "
    "its error on other data."
)
_AS_THEY_ARE = "without_estimate", "without_reference", "trace_period_s", "period_s", "overlaps_training"
"""Of an evaluation, in its JSON."""
_TOO_FEW = 0.8
"""Of the errors, in an interval that is meant to hold 0.9 of them."""
_SHADES = {WARMING_UP: palette.AMBER, DEGRADED: palette.TEAL, COASTING: palette.VIOLET, FAULTED: palette.RED}


def report_of(model: Model, evaluations: Sequence[Evaluation]) -> Report:
    """The report of ``evaluations``; raises :class:`Refused` where the provenance cannot be read."""
    samples = sum(each.scored for each in evaluations)
    many = f"{len(evaluations)} traces" if len(evaluations) > 1 else "one trace"
    rmse = _pooled_rmse([each.metrics for each in evaluations])
    labels = trace_labels(evaluations)
    pairs = list(zip(labels, evaluations))
    seen = [Finding(_SEEN.format(label), "warning") for label, each in pairs if each.overlaps_training]
    every = (Section(label, [_note(each), Figure(partial(_figure, each))], detail=True) for label, each in pairs)
    return Report(
        subject="Model evaluation",
        title=f"{model.name}: {rmse:.2f} degC off (RMSE) over {samples:,} samples of {many}",
        lead=[*seen, *_findings(evaluations, samples), Facts(_facts(model))],
        sections=[Section("", [_metrics_table(evaluations, labels)]), *every],
        data={"model": model.name, "traces": [_trace_data(each) for each in evaluations]},
    )


def trace_labels(evaluations: Sequence[Evaluation]) -> list[str]:
    """A name for each trace: its file's; where two have the same, the whole path, and a number where that repeats."""
    names = [os.path.basename(each.trace) for each in evaluations]
    labels = [name if names.count(name) == 1 else each.trace for name, each in zip(names, evaluations)]
    return [f"{label} {n + 1}" if (n := labels[:index].count(label)) else label for index, label in enumerate(labels)]


def _findings(evaluations: Sequence[Evaluation], samples: int) -> Iterator[Finding]:
    """Over all traces together, each sample counted once."""
    if baselines := [each.baseline.metrics for each in evaluations if each.baseline]:
        yield Finding(f"A static linear formula is {_pooled_rmse(baselines):.2f} degC off.")
    inside = sum(each.coverage[90] * each.scored for each in evaluations) / samples
    within = ((each.low_degC <= each.reference_degC) & (each.reference_degC <= each.high_degC) for each in evaluations)
    widened = sum(int(each.sum()) for each in within) / samples
    shown = f"The 90 % interval that a device publishes holds {100 * widened:.1f} % of the errors"
    if f"{100 * widened:.1f}" != f"{100 * inside:.1f}":
        shown += f" ({100 * inside:.1f} % before it is widened for refused, missing or coarse readings)"
    if widened < _TOO_FEW:
        yield Finding(f"{shown}: it is too narrow here. Train on logs that are as long and as varied.", "warning")
    else:
        yield Finding(f"{shown}.")
    # a model without an estimate where it would be wrong must not look good
    if without := sum(each.without_estimate for each in evaluations):
        yield Finding(f"{without:,} more samples have no estimate.")


def _metrics_table(evaluations: Sequence[Evaluation], labels: Sequence[str]) -> Table:
    rows: list[tuple[str, ...]] = []
    for label, each in zip(labels, evaluations):
        trace = f"{label} (training data)" if each.overlaps_training else label
        shares = "/".join(f"{100 * share:.1f}" for share in each.published_coverage.values())
        for method, metrics in each.by_method.items():
            low, high = metrics.interval_degC[98]
            errors = f"{metrics.rmse_degC:.2f}", f"{metrics.mae_degC:.2f}", f"{metrics.mbe_degC:+.2f}"
            inside = shares if method == "model" else "-"
            rows.append((trace, method, *errors, f"{low:+.2f} to {high:+.2f}", inside, f"{metrics.samples:,}"))
    return Table(_CAPTION, _COLUMNS, rows, labels=2)


def _pooled_rmse(metrics: Sequence[Metrics]) -> float:
    squares = sum(each.samples * each.rmse_degC**2 for each in metrics)
    return float(np.sqrt(squares / sum(each.samples for each in metrics)))


def _facts(model: Model) -> list[tuple[str, str | list[str]]]:
    main = model.main
    circuit = model.provenance.get("circuit")
    training = [str(span) for span in provenance_of(model).training]
    variance = model.error_variance
    quantiles, unit = (main.interval, "degC") if variance is None else (variance.quantiles, "sigma")
    bands = ", ".join(f"{level} %: {low:+.2f} to {high:+.2f} {unit}" for level, (low, high) in quantiles.items())
    outside = " and outside of what training has estimated" if variance and variance.beyond else ""
    growing = f"; sigma grows with the estimate's rate of change{outside}" if variance else ""
    return [
        ("circuit", circuit if isinstance(circuit, str) else "not named in the model file"),
        ("estimates", model.output),
        ("reads", [f"{each.name}, {each.min:g} to {each.max:g} {written(each.unit)}" for each in main.inputs]),
        ("periods", ", ".join(f"{each.period_s:g} s" for each in main.discrete)),
        ("interval in the file", bands + growing),
        ("trained on", training or "not named in the model file"),
        ("created", model.created),
    ]


def _note(evaluation: Evaluation) -> str:
    start, stop = evaluation.time_s[0], evaluation.time_s[-1]
    counts = ((evaluation.without_estimate, "an estimate"), (evaluation.without_reference, "a reference"))
    unscored = " and ".join(f"{count:,} without {what}" for count, what in counts if count)
    scored = f"{evaluation.scored:,} samples scored{f', not scored: {unscored}' if unscored else ''}"
    every = f"a sample every {evaluation.trace_period_s:.5g} s, recursion at {evaluation.period_s:g} s"
    return f"{start:.10g} to {stop:.10g} s, {every}; {scored}."


def _figure(evaluation: Evaluation) -> Plot:
    estimates = [
        plots.Line("estimate", evaluation.estimate_degC, palette.ESTIMATE),
        plots.Line("reference", evaluation.reference_degC, palette.REFERENCE),
    ]
    if evaluation.baseline:
        estimates.insert(0, plots.Line(STATIC_LINEAR, evaluation.baseline.estimate_degC, palette.BASELINE, width=1.0))
    published = plots.Band("published 90 %", evaluation.low_degC, evaluation.high_degC, palette.INTERVAL)
    rolling = f"{ROLLING_LEVEL_PERCENT} % of the error over {ROLLING_SAMPLES} samples"
    band = plots.Band(rolling, *rolling_band(evaluation.error_degC), palette.ESTIMATE)
    errors = [plots.Line("error", evaluation.error_degC, palette.ERROR, width=1.0)]
    panels = [
        plots.Panel("ambient [°C]", estimates, [published], height_px=320),
        plots.Panel("true − estimate [°C]", errors, [band]),
    ]
    colours = palette.sensor_colours(each.name for each in evaluation.inputs)
    for unit in dict.fromkeys(each.unit for each in evaluation.inputs):
        sensors = [(each.name, values) for each, values in evaluation.inputs.items() if each.unit == unit]
        lines = [plots.Line(name, values, colours[name]) for name, values in sensors]
        panels.append(plots.Panel(f"sensors [{written(unit)}]", lines))
    shades = [
        plots.Shade(status.replace("_", " "), colour, spans)
        for status, colour in _SHADES.items()
        if (spans := plots.spans_where(evaluation.time_s, evaluation.status == status))
    ]
    return plots.stacked_figure(evaluation.time_s, panels, shades)


def _trace_data(evaluation: Evaluation) -> dict[str, Any]:
    data = {
        "trace": evaluation.trace,
        **_metrics_data(evaluation.metrics),
        "coverage": {str(level): share for level, share in evaluation.coverage.items()},
        "published_coverage": {str(level): share for level, share in evaluation.published_coverage.items()},
        "status": dict(Counter(evaluation.status.tolist())),
        "unscored": evaluation.without_estimate + evaluation.without_reference,
        **{name: getattr(evaluation, name) for name in _AS_THEY_ARE},
    }
    if evaluation.run_in:
        data["run_in"] = _metrics_data(evaluation.run_in)
    if evaluation.baseline:
        data["baseline"] = {"kind": STATIC_LINEAR, **_metrics_data(evaluation.baseline.metrics)}
    return data


def _metrics_data(metrics: Metrics) -> dict[str, Any]:
    return {**asdict(metrics), "interval_degC": {str(level): list(b) for level, b in metrics.interval_degC.items()}}
