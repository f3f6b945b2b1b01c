"""The figures of the thesis's chapters 4 and 5, drawn from simulated runs, and published against simulated errors."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import plotly.graph_objects as go  # type: ignore[import-untyped]

from ambient_studies.thesis.names import method_name
from ambient_studies.thesis.published import MODELS
from ambient_studies.thesis.rows import Row, like_published
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.evaluation.metrics import ROLLING_LEVEL_PERCENT, ROLLING_SAMPLES, rolling_band
from ambient_trainer.report.plots import (
    BLUE,
    INK,
    SENSOR_COLOURS,
    SKY,
    Band,
    Line,
    Panel,
    stacked_figure,
    with_legend_above,
)

_SOC = "#e58a6f"
_BAND = f"{ROLLING_LEVEL_PERCENT} % band"
_HEIGHT_PX = 380
_SCATTER_HEIGHT_PX = 520

_SCENARIO_COLOURS = dict(zip(("1", "2.1", "2.3", "2.4", "3", "4"), SENSOR_COLOURS))
_SYMBOLS = (
    "circle", "square", "diamond", "cross", "x", "star", "triangle-up", "triangle-down", "pentagon", "hexagram"
)  # fmt: skip


class Drawn(NamedTuple):
    """A figure with what it is called and what is to be said of it."""

    number: str
    title: str
    note: str
    figure: go.Figure


ESTIMATES = {
    "5.1": ("model1_kirchhoff",),
    "5.2": ("model1_ss",),
    "5.3": ("model1_ss_single_input",),
    "5.4": ("model2_ss",),
    "5.5": ("model2_ss_single_input",),
    "5.6": ("model2_ss_free_cd",),
    "5.7": ("linear_battery", "linear_usb", "linear_flash"),
    "5.8": ("linear_combined",),
}
"""The models that each figure of section 5.1 shows."""


def raw_sensors(loaded: Trace) -> Drawn:
    """Figure 4.1 from a run of scenario 2.1 with every zone."""
    shown = {
        "soc": "SoC", "board1": "Board 1", "board2": "Board 2",
        "flash": "flash", "battery": "battery", "usb": "USB", "display": "display",
    }  # fmt: skip
    lines = [
        Line(label, loaded.columns[f"{zone}_degC"], colour)
        for (zone, label), colour in zip(shown.items(), itertools.cycle(SENSOR_COLOURS))
        if f"{zone}_degC" in loaded.columns
    ]
    note = "Scenario 2.1, simulated: the sensors near the SoC follow it, the others lag behind."
    return Drawn("4.1", "Raw sensors under load", note, _plot(loaded.time_s, lines))


def display_on_and_off(off: Trace, on: Trace, display_W: float) -> Drawn:
    """Figure 4.5 from two runs of scenario 2.1 with the same weather and noise."""
    warmer = float((on.columns["display_degC"] - off.columns["display_degC"]).max())
    lines = [
        Line("display on", on.columns["display_degC"], SENSOR_COLOURS[1]),
        Line("display off", off.columns["display_degC"], SENSOR_COLOURS[0]),
    ]
    note = (
        f"Scenario 2.1, simulated: with the display on, {display_W:g} W more are set free in it, which warms its "
        f"sensor by up to {warmer:.1f} °C. The thesis saw 1 to 2 °C."
    )
    return Drawn("4.5", "Display sensor with the display on and off, all cores loaded", note, _plot(off.time_s, lines))


def estimate_figures(trace: Trace, estimates: Mapping[tuple[str, str, str], Array]) -> list[Drawn]:
    """Figures 5.1 to 5.8 on the run ``trace`` of scenario 4, for the models that ``estimates`` has."""
    return [
        _estimates(number, models, trace, estimates)
        for number, models in ESTIMATES.items()
        if all(("4", model, "corrected") in estimates for model in models)
    ]


def youtube(trace: Trace) -> Drawn:
    """Figure 5.9 on a run of scenario 2.4."""
    lines = [
        Line(label, trace.columns[f"{sensor}_degC"], colour)
        for (sensor, label), colour in zip(
            {"soc": "SoC", "flash": "flash", "battery": "battery", "usb": "USB", "display": "display"}.items(),
            SENSOR_COLOURS,
        )
    ]
    note = "Scenario 2.4, simulated: the load of the SoC varies, and the other sensors stay calm."
    return Drawn("5.9", "Sensors while video is streamed", note, _plot(trace.time_s, lines))


def scatter(rows: Sequence[Row]) -> go.Figure:
    """Published against simulated RMSE on logarithmic axes: a colour a scenario, a symbol a model."""
    compared = [row for row in like_published(rows) if row.reproduced is not None]
    figure = go.Figure()
    edges = [value for row in compared for value in _pair(row)]
    low, high = 0.7 * min(edges, default=0.1), 1.4 * max(edges, default=10.0)
    for factor, dash in ((1.0, "solid"), (2.0, "dot"), (0.5, "dot")):
        figure.add_scatter(
            x=[low, high], y=[low * factor, high * factor], mode="lines", hoverinfo="skip", showlegend=False,
            line={"color": "#9ca3af", "dash": dash, "width": 1.2},
        )  # fmt: skip
    for scenario, colour in _SCENARIO_COLOURS.items():
        here = [row for row in compared if row.scenario == scenario]
        figure.add_scatter(
            x=[_pair(row)[0] for row in here],
            y=[_pair(row)[1] for row in here],
            text=[f"{method_name(row.model)}{', non-causal' if row.variant == 'noncausal' else ''}" for row in here],
            name=f"scenario {scenario}",
            mode="markers",
            marker={
                "color": colour,
                "size": 10,
                "symbol": [_SYMBOLS[list(MODELS).index(row.model)] for row in here],
                "line": {"width": 0.6, "color": "white"},
            },
            hovertemplate="%{text}<br>published %{x:.2f} °C, simulated %{y:.2f} °C",
        )
    ticks = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50]
    axis = {
        "type": "log", "gridcolor": "#e5e7eb", "linecolor": "#9ca3af", "showline": True, "zeroline": False,
        "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks],
    }  # fmt: skip
    figure.update_xaxes(**axis, title_text="published RMSE [°C]")
    figure.update_yaxes(**axis, title_text="simulated RMSE [°C]")
    figure.update_layout(
        template="none", height=_SCATTER_HEIGHT_PX, margin={"l": 62, "r": 12, "t": 40, "b": 60},
        font={"family": "system-ui, -apple-system, sans-serif", "size": 13, "color": "#1f2937"},
        plot_bgcolor="white", paper_bgcolor="white",
    )  # fmt: skip
    return with_legend_above(figure)


def _estimates(
    number: str, models: Sequence[str], trace: Trace, estimates: Mapping[tuple[str, str, str], Array]
) -> Drawn:
    alone = len(models) == 1
    lines = [Line("SoC", trace.columns["soc_degC"], _SOC, width=0.9)]
    bands = []
    for model, colour in zip(models, [BLUE] if alone else SENSOR_COLOURS):
        estimate = estimates["4", model, "corrected"]
        low, high = rolling_band(trace.reference - estimate)
        name = model.removeprefix("linear_")
        bands.append(
            Band(_BAND if alone else f"band, {name}", estimate + low, estimate + high, SKY if alone else colour)
        )
        lines.append(Line("estimate" if alone else name, estimate, colour))
    lines.append(Line("ambient", trace.reference, INK))
    title = method_name(models[0]) if alone else "Linear battery, USB and flash"
    note = (
        "Scenario 4, simulated; the equations as corrected, fitted to scenario 5. The band is the estimate plus where "
        f"{ROLLING_LEVEL_PERCENT} % of the errors of {ROLLING_SAMPLES} successive samples lie: on the ambient, and "
        "wide where the error changes fast."
    )
    return Drawn(number, title, note, _plot(trace.time_s, lines, bands))


def _plot(time_s: Array, lines: Sequence[Line], bands: Sequence[Band] = ()) -> go.Figure:
    panel = Panel("temperature [°C]", lines, bands, height_px=_HEIGHT_PX)
    return stacked_figure(time_s, [panel])


def _pair(row: Row) -> tuple[float, float]:
    assert row.published is not None
    assert row.reproduced is not None
    return row.published.rmse_degC, max(row.reproduced.rmse_degC, 1e-3)
