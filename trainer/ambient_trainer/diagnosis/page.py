"""The diagnosis as a page: the verdict in words on top, what it rests on beneath, how it was done in small print."""

from __future__ import annotations

import itertools
import os
import re
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go  # type: ignore[import-untyped]
from markupsafe import Markup, escape

from ambient_model.trace import split_column
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Array, Diagnosis, Step
from ambient_trainer.diagnosis.summary import (
    SHOWN_RANKED,
    headline,
    misfit_table,
    ranking_table,
    remarks,
    residuals_table,
    size_in_words,
    steps_table,
)
from ambient_trainer.diagnosis.words import chance, clock, duration, window
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import (
    BLUE,
    INK,
    ORANGE,
    POINTS_PER_LINE,
    SAND,
    SENSOR_COLOURS,
    SKY,
    Line,
    Panel,
    Shade,
    panel_figure,
    stacked_figure,
    to_markup,
    with_legend_above,
)
from ambient_trainer.report.table import Table
from ambient_trainer.report.units import written

_STEP_COLOURS = (BLUE, "#009e73", "#7a5195", "#cc79a7")
_SHADE_COLOURS = ("#e3a008", "#009e73", "#7a5195", "#cc79a7")
_SMOOTH_FRAC = 1 / 150


def diagnosis_page(diagnosis: Diagnosis) -> str:
    """The report on ``diagnosis`` as HTML."""
    shades = _shades(diagnosis)
    beyond = sum(each.significant for each in diagnosis.misfit.tests)
    error = diagnosis.misfit.ambient_error_degC
    return render(
        "diagnosis.html",
        trace=os.path.basename(diagnosis.trace),
        circuit=diagnosis.circuit,
        cause=diagnosis.verdict_cause.name,
        settled=diagnosis.verdict_cause.name not in (NONE, UNKNOWN),
        headline=headline(diagnosis),
        facts=_facts(diagnosis),
        remarks=[_coded(each) for each in remarks(diagnosis)],
        steps=_shown(steps_table(diagnosis)) if diagnosis.explained else None,
        sentences=[step.sentence for step in diagnosis.explained],
        meanings=_meanings(diagnosis),
        gains=to_markup(_gains(diagnosis), "gains") if diagnosis.explained else None,
        simulated=to_markup(_simulated(diagnosis, shades), "simulated"),
        heat=to_markup(_heat(diagnosis, shades), "heat"),
        heat_unit=diagnosis.misfit.heat_unit,
        beneath="what drives the causes found" if _driving(diagnosis) else "what was logged besides and varies",
        residuals=to_markup(_residuals(diagnosis, shades), "residuals"),
        sensors=_shown(residuals_table(diagnosis)),
        ambient=None if error is None else to_markup(_ambient(diagnosis, error, shades), "ambient"),
        ranking=_shown(ranking_table(diagnosis, 2 * SHOWN_RANKED)) if diagnosis.ranking else None,
        tests=_shown(misfit_table(diagnosis.misfit.tests)),
        tests_beyond=f"{beyond} of {len(diagnosis.misfit.tests)}",
        notes=list(diagnosis.notes),
        points=f"{POINTS_PER_LINE:,}",
    )


def _shown(table: Table) -> Table:
    """``table`` with its units as a page writes them."""
    rows = tuple(tuple(cell.replace(" degC", " °C") for cell in row) for row in table.rows)
    return replace(table, rows=rows)


def _coded(text: str) -> Markup:
    """``text`` with what stands between backquotes as code."""
    return Markup(re.sub("`([^`]*)`", r"<code>\1</code>", str(escape(text))))


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str | list[str]]]:
    time_s = diagnosis.time_s
    facts: list[tuple[str, str | list[str]]] = [
        ("trace", diagnosis.trace),
        ("circuit", diagnosis.circuit),
        (
            "time",
            f"{clock(time_s[0])} to {clock(time_s[-1])}, {len(time_s):,} samples, one every "
            f"{duration(float(np.median(np.diff(time_s))))}",
        ),
        ("sensors", ", ".join(diagnosis.misfit.sensors)),
        ("baseline", list(diagnosis.baselines) or "none: the question is what the circuit lacks"),
    ]
    for step in diagnosis.explained[:1]:
        facts.append(("when", window(step.onset_s, step.end_s)))
        if step.magnitude is not None:
            said = f"{size_in_words(step.magnitude)}: {step.magnitude.meaning}"
            facts.append(("how much", said.replace(" degC", " °C")))
        facts.append(("confidence", f"{100 * step.confidence:.1f} %"))
    return facts


def _meanings(diagnosis: Diagnosis) -> list[tuple[str, list[str]]]:
    """Per step every number of its extension."""
    return [
        (
            str(step.cause),
            [f"{name} = {value:.4g} {unit if unit != '1' else ''}".rstrip() for name, (value, unit) in numbers],
        )
        for step in diagnosis.explained
        if (numbers := step.parameters.items())
    ]


def _shades(diagnosis: Diagnosis) -> list[Shade]:
    """The windows of the steps that last for a part of the trace only."""
    first, last = float(diagnosis.time_s[0]), float(diagnosis.time_s[-1])
    return [
        Shade(
            str(step.cause),
            colour,
            [(first if step.onset_s is None else step.onset_s, last if step.end_s is None else step.end_s)],
        )
        for step, colour in zip(diagnosis.explained, itertools.cycle(_SHADE_COLOURS))
        if step.onset_s is not None or step.end_s is not None
    ]


def _simulated(diagnosis: Diagnosis, shades: list[Shade]) -> go.Figure:
    misfit = diagnosis.misfit
    last = diagnosis.explained[-1] if diagnosis.explained else None
    panels = []
    for number, (sensor, measured, simulated) in enumerate(
        zip(misfit.sensors, misfit.measured_degC, misfit.simulated_degC)
    ):
        lines = [Line("measured", measured, INK, 1.4), Line("simulated, circuit as given", simulated, ORANGE, 1.4)]
        if last is not None:
            lines.append(Line("simulated with the causes found", measured - last.residual_degC[number], BLUE, 1.4))
        panels.append(Panel(f"{sensor} [°C]", lines, height_px=170))
    return stacked_figure(diagnosis.time_s, panels, shades)


def _heat(diagnosis: Diagnosis, shades: list[Shade]) -> go.Figure:
    """The residual heat of each node, the one found first, and beneath it the signals that drive the steps, or all."""
    misfit = diagnosis.misfit
    located = [_sensor_of(step, misfit.sensors) for step in diagnosis.explained]
    order = dict.fromkeys([*(each for each in located if each), *misfit.sensors])
    window_samples = max(1, round(len(diagnosis.time_s) * _SMOOTH_FRAC))
    panels = []
    for sensor in order:
        heat = misfit.heat[misfit.sensors.index(sensor)]
        lines = [
            Line("as it is", heat, SKY, 0.8),
            Line(f"mean of {window_samples} samples", _running_mean(heat, window_samples), BLUE, 1.8),
        ]
        panels.append(Panel(f"{sensor} [{misfit.heat_unit}]", lines, height_px=170 if sensor in located else 120))
    signals = _driving(diagnosis) or [name for name, row in diagnosis.signals.items() if _varies(name, row)]
    for name, colour in zip(signals, itertools.cycle(SENSOR_COLOURS[1:])):
        panels.append(Panel(_label(name), [Line(name, diagnosis.signals[name], colour)], height_px=110))
    figure = stacked_figure(diagnosis.time_s, panels, shades)
    for row, sensor in enumerate(order, start=1):
        heat = misfit.heat[misfit.sensors.index(sensor)]
        if np.isfinite(heat).any():
            # a few spikes must not flatten what lasts
            figure.update_yaxes(range=_range(heat, window_samples), row=row, col=1)
    return figure


def _driving(diagnosis: Diagnosis) -> list[str]:
    """The logged signals that drive what was found."""
    named = dict.fromkeys(step.cause.signal for step in diagnosis.explained)
    return [name for name in diagnosis.signals if name in named]


def _varies(signal: str, row: Array) -> bool:
    known = row[np.isfinite(row)]
    return split_column(signal)[1] != "degC" and bool((known != known[:1]).any())


def _residuals(diagnosis: Diagnosis, shades: list[Shade]) -> go.Figure:
    panels = []
    for number, (sensor, residual) in enumerate(zip(diagnosis.misfit.sensors, diagnosis.misfit.residual_degC)):
        lines = [Line("circuit as given", residual, ORANGE, 1.2)]
        lines += [
            Line(f"with {'' if k == 1 else 'also '}{step.cause}", step.residual_degC[number], colour, 1.2)
            for k, (step, colour) in enumerate(zip(diagnosis.explained, itertools.cycle(_STEP_COLOURS)), start=1)
        ]
        panels.append(Panel(f"{sensor} [°C]", lines, height_px=150))
    return stacked_figure(diagnosis.time_s, panels, shades)


def _ambient(diagnosis: Diagnosis, error: Array, shades: list[Shade]) -> go.Figure:
    panel = Panel("true − estimate [°C]", [Line("error of the ambient", error, ORANGE, 1.2)], height_px=190)
    return stacked_figure(diagnosis.time_s, [panel], shades)


def _gains(diagnosis: Diagnosis) -> go.Figure:
    """The held-out error without and with each step, a pair of bars a step, and the gain's interval in words."""
    names = [f"{number}. {step.cause}" for number, step in enumerate(diagnosis.explained, start=1)][::-1]
    steps = diagnosis.explained[::-1]
    figure = panel_figure("held-out RMSE over all sensors [°C]", "", height_px=100 + 115 * len(steps))
    for name, colour, values in (
        ("with it", BLUE, [step.gain.rmse_after_degC for step in steps]),
        ("without", SAND, [step.gain.rmse_before_degC for step in steps]),
    ):
        figure.add_bar(
            y=names,
            x=values,
            name=name,
            orientation="h",
            marker_color=colour,
            text=[f"{value:.3f} °C" for value in values],
            textposition="auto",
            insidetextanchor="start",
        )
    for name, step in zip(names, steps):
        low, high = step.gain.ci95_degC
        figure.add_annotation(
            x=0, y=name, xref="paper", xanchor="left", yshift=46, showarrow=False, align="left",
            text=f"<b>{name}</b><br>gain {low:.3f} to {high:.3f} °C, {chance(step.gain.p_value).replace('<', '&lt;')}",
        )  # fmt: skip
    figure.update_yaxes(showticklabels=False)
    figure.update_layout(bargap=0.6, legend_traceorder="reversed", margin_l=12)
    return with_legend_above(figure)


def _sensor_of(step: Step, sensors: tuple[str, ...]) -> str | None:
    """The sensor at the node where the step is, if it is at one."""
    places = (step.cause.location or "").split("-")
    return next((sensor for sensor in sensors if sensor in places), None)


def _label(signal: str) -> str:
    """``cpu_load_frac`` as ``cpu_load`` above ``[fraction]``: a panel is not as high as both are long."""
    name, unit = split_column(signal)
    return f"{name}\n[{written(unit)}]"


def _running_mean(values: Array, samples: int) -> Array:
    known = np.isfinite(values)
    kernel = np.ones(samples)
    counts = np.convolve(known, kernel, mode="same")
    sums = np.convolve(np.where(known, values, 0.0), kernel, mode="same")
    return np.asarray(np.where(counts > 0, sums / np.maximum(counts, 1), np.nan))


def _range(heat: Array, samples: int) -> tuple[float, float]:
    mean = _running_mean(heat, samples)
    low, high = np.nanpercentile(heat, [2, 98])
    low, high = min(low, np.nanmin(mean), 0.0), max(high, np.nanmax(mean), 0.0)
    room = 0.08 * (high - low) or 1.0
    return float(low - room), float(high + room)
