"""The evaluation as a page: what the model is, its figures, and per trace what it said and how wrong that was."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from ambient_model.model import Model
from ambient_model.tracking import COASTING, DEGRADED, FAULTED, WARMING_UP
from ambient_trainer.estimation.static_linear import STATIC_LINEAR
from ambient_trainer.evaluation.evaluate import Evaluation
from ambient_trainer.evaluation.metrics import ROLLING_LEVEL_PERCENT, ROLLING_SAMPLES, rolling_band
from ambient_trainer.evaluation.provenance import training_spans
from ambient_trainer.evaluation.summary import figures_table, labels, verdict, warnings
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import (
    BLUE,
    INK,
    ORANGE,
    POINTS_PER_LINE,
    SAND,
    SENSOR_COLOURS,
    SKY,
    Band,
    Line,
    Panel,
    Shade,
    spans_where,
    stacked_figure,
    to_markup,
)
from ambient_trainer.report.units import written

_SHADES = {
    WARMING_UP: ("warming up", "#e3a008"),
    DEGRADED: ("guard has a say", "#0d9488"),
    COASTING: ("coasting", "#8b5cf6"),
    FAULTED: ("faulted", "#dc2626"),
}


def evaluation_page(model: Model, evaluations: Sequence[Evaluation]) -> str:
    """The report on ``evaluations`` as HTML; raises :class:`Refused` where the provenance cannot be read."""
    return render(
        "evaluation.html",
        name=model.name,
        facts=_facts(model),
        warnings=warnings(evaluations),
        verdict=verdict(evaluations),
        table=figures_table(evaluations),
        traces=[
            {
                "label": label,
                "note": _note(each),
                "plot": to_markup(stacked_figure(each.time_s, _panels(each), _shades(each)), f"trace-{number}"),
            }
            for number, (label, each) in enumerate(zip(labels(evaluations), evaluations), start=1)
        ],
        points=f"{POINTS_PER_LINE:,}",
    )


def _facts(model: Model) -> list[tuple[str, str | list[str]]]:
    main = model.main
    circuit = model.provenance.get("circuit")
    training = [str(span) for span in training_spans(model)]
    return [
        ("circuit", circuit if isinstance(circuit, str) else "not named in the model file"),
        ("estimates", model.output),
        ("reads", [f"{each.name}, {each.min:g} to {each.max:g} {written(each.unit)}" for each in main.inputs]),
        ("periods", ", ".join(f"{each.period_s:g} s" for each in main.discrete)),
        ("published interval", _published(model)),
        ("trained on", training or "not named in the model file"),
        ("created", model.created),
    ]


def _published(model: Model) -> str:
    quantiles, unit = model.main.interval, "°C"
    if model.error_variance is not None:
        quantiles, unit = model.error_variance.quantiles, "sigma"
    told = ", ".join(f"{level} %: {low:+.2f} to {high:+.2f} {unit}" for level, (low, high) in quantiles.items())
    return told if model.error_variance is None else f"{told}; sigma grows with the estimate's unrest"


def _note(evaluation: Evaluation) -> str:
    start, stop = evaluation.time_s[0], evaluation.time_s[-1]
    unscored = [
        f"{count:,} without {what}"
        for count, what in ((evaluation.without_estimate, "an estimate"), (evaluation.without_reference, "a reference"))
        if count
    ]
    return (
        f"{start:g} to {stop:g} s, a sample every {evaluation.trace_period_s:.3g} s, recursion at "
        f"{evaluation.period_s:g} s; {evaluation.scored:,} samples scored"
        f"{', not scored: ' + ' and '.join(unscored) if unscored else ''}."
    )


def _panels(evaluation: Evaluation) -> list[Panel]:
    estimates = [Line("estimate", evaluation.estimate_degC, BLUE), Line("reference", evaluation.reference_degC, INK)]
    if evaluation.baseline:
        estimates.insert(0, Line(STATIC_LINEAR, evaluation.baseline.estimate_degC, SAND, width=1.0))
    published = Band("published 90 %", evaluation.low_degC, evaluation.high_degC, SKY)
    rolling = Band(
        f"{ROLLING_LEVEL_PERCENT} % of the error over {ROLLING_SAMPLES} samples",
        *rolling_band(evaluation.error_degC),
        BLUE,
    )
    return [
        Panel("ambient [°C]", estimates, [published], height_px=320),
        Panel("true − estimate [°C]", [Line("error", evaluation.error_degC, ORANGE, width=1.0)], [rolling]),
        *_sensor_panels(evaluation),
    ]


def _sensor_panels(evaluation: Evaluation) -> list[Panel]:
    """The inputs as logged, one panel a unit."""
    by_unit: dict[str, list[Line]] = {}
    for (sensor, values), colour in zip(evaluation.inputs.items(), itertools.cycle(SENSOR_COLOURS)):
        by_unit.setdefault(sensor.unit, []).append(Line(sensor.name, values, colour))
    return [Panel(f"sensors [{written(unit)}]", lines) for unit, lines in by_unit.items()]


def _shades(evaluation: Evaluation) -> list[Shade]:
    return [
        Shade(name, colour, spans)
        for status, (name, colour) in _SHADES.items()
        if (spans := spans_where(evaluation.time_s, evaluation.status == status))
    ]
