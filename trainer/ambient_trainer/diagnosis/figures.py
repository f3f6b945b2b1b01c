"""The plots of a diagnosis: measured and simulated, the heat that would explain the difference, residuals, gains."""

import itertools
from collections.abc import Sequence

import numpy as np
import pandas as pd

from ambient_model.trace import split_column
from ambient_trainer.data.units import written
from ambient_trainer.diagnosis.greybox.expression import Expression, Samples
from ambient_trainer.diagnosis.result import Array, Diagnosis, Step
from ambient_trainer.report import palette
from ambient_trainer.report.plots import Line, Panel, Shade, panel_figure, stacked_figure, wrapped
from ambient_trainer.report.structure import Plot
from ambient_trainer.report.words import chance

_SMOOTH_FRAC = 1 / 150
_POINTS = 300


def _shades(diagnosis: Diagnosis) -> list[Shade]:
    """The windows of the steps that last for a part of the trace only."""
    shades, (first, last) = [], diagnosis.time_s[[0, -1]].tolist()
    for step, colour in zip(diagnosis.explained, itertools.cycle(palette.SHADE_COLOURS)):
        if (step.onset_s, step.end_s) != (None, None):
            span = first if step.onset_s is None else step.onset_s, last if step.end_s is None else step.end_s
            shades.append(Shade(str(step.cause), colour, [span]))
    return shades


def _by_sensor(diagnosis: Diagnosis, curves: Sequence[tuple[str, Array, str]], width: float, height_px: int) -> Plot:
    """A panel a sensor, with its row of each of ``curves``: their names, rows (s, N) and colours."""
    panels = []
    for number, sensor in enumerate(diagnosis.misfit.sensors):
        lines = [Line(name, rows[number], colour, width) for name, rows, colour in curves]
        panels.append(Panel(f"{sensor} [°C]", lines, height_px=height_px))
    return stacked_figure(diagnosis.time_s, panels, _shades(diagnosis))


def simulated(diagnosis: Diagnosis) -> Plot:
    """A panel a sensor: measured, simulated by the circuit as given, and by the circuit with every step."""
    measured, given = diagnosis.misfit.measured_degC, diagnosis.misfit.simulated_degC
    curves = [("measured", measured, palette.MEASURED), ("simulated, circuit as given", given, palette.SIMULATED)]
    for step in diagnosis.explained[-1:]:
        curves.append(("simulated with the causes", measured - step.residual_degC, palette.EXTENDED))
    return _by_sensor(diagnosis, curves, 1.4, 170)


def heat(diagnosis: Diagnosis) -> Plot:
    """The residual heat of each node, the first step's on top; beneath it the signals that drive the steps, or all."""
    misfit, flows = diagnosis.misfit, _heat(diagnosis)
    located = [_sensor_of(step, misfit.sensors) for step in diagnosis.explained]
    order = dict.fromkeys([*(each for each in located if each), *misfit.sensors])
    window_samples = max(1, round(len(diagnosis.time_s) * _SMOOTH_FRAC))
    panels = []
    for sensor in order:
        lines = [
            Line("as it is", flows[sensor], palette.SKY, 0.8),
            Line(f"mean of {window_samples} samples", _running_mean(flows[sensor], window_samples), palette.BLUE, 1.8),
        ]
        panels.append(Panel(f"{sensor} [{misfit.heat_unit}]", lines, height_px=170 if sensor in located else 120))
    signals = driving(diagnosis) or [name for name, row in diagnosis.signals.items() if _varies(name, row)]
    for name, colour in zip(signals, itertools.cycle(palette.SENSOR_COLOURS[1:])):
        panels.append(Panel(_label(name), [Line(name, diagnosis.signals[name], colour)], height_px=110))
    figure = stacked_figure(diagnosis.time_s, panels, _shades(diagnosis))
    for row, sensor in enumerate(order, start=1):
        if np.isfinite(flows[sensor]).any():
            # a few spikes must not flatten what lasts
            figure.update_yaxes(range=_range(flows[sensor], window_samples), row=row, col=1)
    return figure


def heat_by_driver(diagnosis: Diagnosis) -> tuple[str, str] | None:
    """Driver and sensor of the first step that is heat by logged columns where a sensor is; None where none is."""
    for step in diagnosis.explained:
        text, sensor = step.cause.signal, _sensor_of(step, diagnosis.misfit.sensors)
        if step.cause.name == "heat_source" and text is not None and sensor is not None:
            known = np.isfinite(_heat(diagnosis)[sensor]).any()
            if known and set(Expression(text).columns) <= set(diagnosis.signals):
                return text, sensor
    return None


def against_driver(diagnosis: Diagnosis, text: str, sensor: str) -> Plot:
    """The residual heat at a sensor's node over its driver, by means of stretches, and a straight line through them."""
    samples = Samples(diagnosis.signals, float(np.median(np.diff(diagnosis.time_s))))
    weight, flow = Expression(text).value(samples), _heat(diagnosis)[sensor]
    known = np.flatnonzero(np.isfinite(flow) & np.isfinite(weight))
    stretches = np.array_split(known, min(_POINTS, len(known)))
    x, y = (np.array([row[each].mean() for each in stretches]) for row in (weight, flow))
    slope, level = np.polyfit(x, y, 1)
    ends = np.array([x.min(), x.max()])
    figure = panel_figure(text, f"heat at {sensor} [{diagnosis.misfit.heat_unit}]", height_px=300)
    figure.add_scatter(x=x, y=y, mode="markers", name="mean of a stretch", marker_color=palette.BLUE)
    figure.add_scatter(x=ends, y=level + slope * ends, mode="lines", name="straight line", line_color=palette.EXTENDED)
    return figure


def _heat(diagnosis: Diagnosis) -> dict[str, Array]:
    return dict(zip(diagnosis.misfit.sensors, diagnosis.misfit.heat))


def driving(diagnosis: Diagnosis) -> list[str]:
    """The logged signals that drive the steps."""
    texts = [step.cause.signal for step in diagnosis.explained if step.cause.signal is not None]
    named = {name for text in texts for name in Expression(text).columns}
    return [name for name in diagnosis.signals if name in named]


def _varies(signal: str, row: Array) -> bool:
    known = row[np.isfinite(row)]
    return split_column(signal)[1] != "degC" and bool((known != known[:1]).any())


def residuals(diagnosis: Diagnosis) -> Plot:
    """A panel a sensor: the residual of the circuit as given, and after each step."""
    curves = [("circuit as given", diagnosis.misfit.residual_degC, palette.SIMULATED)]
    for step, colour in zip(diagnosis.explained, itertools.cycle(palette.STEP_COLOURS)):
        curves.append((f"with {'also ' if len(curves) > 1 else ''}{step.cause}", step.residual_degC, colour))
    return _by_sensor(diagnosis, curves, 1.2, 150)


def ambient(diagnosis: Diagnosis) -> Plot:
    """The error of the ambient that the circuit gives when read backward."""
    error = np.asarray(diagnosis.misfit.ambient_error_degC)
    panel = Panel("true − estimate [°C]", [Line("error of the ambient", error, palette.ERROR, 1.2)], height_px=190)
    return stacked_figure(diagnosis.time_s, [panel], _shades(diagnosis))


def gains(diagnosis: Diagnosis) -> Plot:
    """The held-out error without and with each step, a pair of bars a step, and the gain's interval in words."""
    names = [f"{number}. {step.cause}" for number, step in enumerate(diagnosis.explained, start=1)][::-1]
    steps = diagnosis.explained[::-1]
    figure = panel_figure("held-out RMSE over all sensors [°C]", "", height_px=100 + 135 * len(steps))
    for name, colour, values in (
        ("with it", palette.EXTENDED, [step.gain.rmse_after_degC for step in steps]),
        ("without", palette.BASELINE, [step.gain.rmse_before_degC for step in steps]),
    ):
        figure.add_bar(
            y=names,
            x=values,
            name=name,
            orientation="h",
            marker_color=colour,
            text=[f"{value:.3f} °C" for value in values],
            textposition="outside",
            cliponaxis=False,
        )
    for name, step in zip(names, steps):
        (low, high), p_value = step.gain.ci95_degC, chance(step.gain.p_value).replace("<", "&lt;")
        figure.add_annotation(
            x=0, y=name, xref="paper", xanchor="left", yanchor="bottom", yshift=26, showarrow=False, align="left",
            text=f"<b>{wrapped(name)}</b><br>gain {low:.3f} to {high:.3f} °C, {p_value}",
        )  # fmt: skip
    # room for the figures beside the bars, and for what stands above the first
    figure.update_xaxes(range=[0, 1.25 * max(max(each.x) for each in figure.data)])
    figure.update_yaxes(showticklabels=False, range=[-0.5, len(steps) - 0.35])
    figure.update_layout(bargap=0.6, legend_traceorder="reversed", margin_l=12)
    return figure


def _sensor_of(step: Step, sensors: tuple[str, ...]) -> str | None:
    """The sensor at the node where the step is, if it is at one."""
    places = (step.cause.place or "").replace(", ", "-").split("-")
    return next((sensor for sensor in sensors if sensor in places), None)


def _label(signal: str) -> str:
    """``cpu_load_frac`` as ``cpu_load`` above ``[fraction]``: a panel is not as high as both are long."""
    name, unit = split_column(signal)
    return f"{name}\n[{written(unit)}]"


def _running_mean(values: Array, samples: int) -> Array:
    return np.asarray(pd.Series(values).rolling(samples, center=True, min_periods=1).mean())


def _range(heat: Array, samples: int) -> tuple[float, float]:
    mean = _running_mean(heat, samples)
    low, high = np.nanpercentile(heat, [2, 98])
    low, high = min(low, np.nanmin(mean), 0.0), max(high, np.nanmax(mean), 0.0)
    room = 0.08 * (high - low) or 1.0
    return float(low - room), float(high + room)
