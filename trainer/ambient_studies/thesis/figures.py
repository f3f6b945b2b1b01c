"""The figures of the thesis's chapters 4 and 5, drawn from simulated runs, and published against simulated errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ambient_studies.thesis.published import MODELS, method_name
from ambient_studies.thesis.reproduction import Reproduction
from ambient_studies.thesis.rows import Row, like_published
from ambient_trainer.data import Array, Trace
from ambient_trainer.evaluation import ROLLING_LEVEL_PERCENT, ROLLING_SAMPLES, rolling_band
from ambient_trainer.report import Figure, Section, palette, plots
from ambient_trainer.simulator import load_device, simulate

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

_HEIGHT_PX = 380
_SCATTER_HEIGHT_PX = 520
_LOADED = "2.1"
_DISPLAY_W = 0.4
"""Heat of a display at full brightness; chosen, somewhat above what streaming takes."""

_SCENARIO_COLOURS = dict(zip(("1", "2.1", "2.3", "2.4", "3", "4"), palette.SENSOR_COLOURS))
_SYMBOLS = (
    "circle", "square", "diamond", "cross", "x", "star", "triangle-up", "triangle-down", "pentagon", "hexagram"
)  # fmt: skip
_SENSORS = {"soc": "SoC", "flash": "flash", "battery": "battery", "usb": "USB", "display": "display"}
_ZONES = {"soc": "SoC", "board1": "Board 1", "board2": "Board 2", **_SENSORS}
_COLOURS = palette.sensor_colours(_ZONES)

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
"""The models in each figure of section 5.1."""


def figure_sections(reproduction: Reproduction) -> list[Section]:
    """Figures 4.1, 4.5 and 5.1 to 5.9, a section each."""
    seed, evaluated = reproduction.seed, reproduction.runs.evaluated
    estimates, verification = reproduction.evaluated.estimates, evaluated["4"]
    return [
        _section(
            "4.1: Raw sensors under load",
            "Scenario 2.1, simulated: the sensors near the SoC follow it, the others lag behind.",
            lambda: _zones_figure(simulate(_LOADED, seed=seed, all_zones=True).trace, tuple(_ZONES)),
        ),
        _section(
            "4.5: Display sensor with the display on and off, all cores loaded",
            f"Scenario 2.1, simulated: with the display on, it takes {_DISPLAY_W:g} W more. The thesis saw its sensor "
            "1 to 2 °C warmer.",
            partial(_display_figure, seed),
        ),
        *(
            _section(
                f"{number}: {method_name(models[0]) if len(models) == 1 else 'Linear battery, USB and flash'}",
                "Scenario 4, simulated; the equations as corrected, fitted to scenario 5. The band is the estimate "
                f"plus where {ROLLING_LEVEL_PERCENT} % of the errors of {ROLLING_SAMPLES} successive samples lie: on "
                "the ambient, and wide where the error changes fast.",
                partial(_estimates_figure, verification, {m: estimates["4", m, "corrected"] for m in models}),
            )
            for number, models in ESTIMATES.items()
            if all(("4", model, "corrected") in estimates for model in models)
        ),
        _section(
            "5.9: Sensors while video is streamed",
            "Scenario 2.4, simulated: the load of the SoC varies, and the other sensors stay calm.",
            partial(_zones_figure, evaluated["2.4"], tuple(_SENSORS)),
        ),
    ]


def error_figure(rows: Sequence[Row]) -> go.Figure:
    """Published against simulated RMSE on logarithmic axes: a colour a scenario, a symbol a model."""
    points = [
        (row, row.published.rmse_degC, max(row.reproduced.rmse_degC, 1e-3))
        for row in like_published(rows)
        if row.published and row.reproduced
    ]
    figure = plots.panel_figure("published RMSE [°C]", "simulated RMSE [°C]", _SCATTER_HEIGHT_PX)
    edges = [value for _, *pair in points for value in pair]
    low, high = 0.7 * min(edges, default=0.1), 1.4 * max(edges, default=10.0)
    for factor, dash in ((1.0, "solid"), (2.0, "dot"), (0.5, "dot")):
        ends = {"x": [low, high], "y": [low * factor, high * factor]}
        line = {"color": palette.AXIS, "dash": dash, "width": 1.2}
        figure.add_scatter(**ends, mode="lines", hoverinfo="skip", showlegend=False, line=line)
    for scenario, colour in _SCENARIO_COLOURS.items():
        here = [each for each in points if each[0].scenario == scenario]
        symbols = [_SYMBOLS[list(MODELS).index(row.model)] for row, _, _ in here]
        figure.add_scatter(
            x=[published for _, published, _ in here],
            y=[simulated for _, _, simulated in here],
            text=[method_name(row.model) + ", non-causal" * (row.variant == "noncausal") for row, _, _ in here],
            name=f"scenario {scenario}",
            mode="markers",
            marker={"color": colour, "size": 10, "symbol": symbols},
            hovertemplate="%{text}<br>published %{x:.2f} °C, simulated %{y:.2f} °C",
        )
    ticks = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50]
    for axes in (figure.update_xaxes, figure.update_yaxes):
        axes(type="log", tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks])
    return figure


def _section(title: str, note: str, draw: Callable[[], go.Figure]) -> Section:
    return Section(f"Figure {title}", [note, Figure(draw)])


def _zones_figure(trace: Trace, zones: Sequence[str]) -> go.Figure:
    return _plot(trace, [_line(trace, zone) for zone in zones if f"{zone}_degC" in trace.columns])


def _display_figure(seed: int) -> go.Figure:
    """Two runs with the same weather and noise."""
    phone = load_device()
    lit = phone.with_values({f"activities.{name}.heat_W.display": _DISPLAY_W for name in ("idle", "cpu_100")})
    off, on = (simulate(_LOADED, device, seed).trace for device in (phone, lit))
    lines = [
        plots.Line("display on", on.columns["display_degC"], palette.SENSOR_COLOURS[1]),
        plots.Line("display off", off.columns["display_degC"], palette.SENSOR_COLOURS[0]),
    ]
    return _plot(off, lines)


def _estimates_figure(trace: Trace, estimates: dict[str, Array]) -> go.Figure:
    lines, bands = [_line(trace, "soc")], []
    for model, estimate in estimates.items():
        alone, sensor = len(estimates) == 1, model.removeprefix("linear_")
        low, high = rolling_band(trace.reference - estimate)
        band = f"{ROLLING_LEVEL_PERCENT} % band" if alone else f"band, {sensor}"
        bands.append(plots.Band(band, estimate + low, estimate + high, palette.INTERVAL if alone else _COLOURS[sensor]))
        lines.append(
            plots.Line("estimate" if alone else sensor, estimate, palette.ESTIMATE if alone else _COLOURS[sensor])
        )
    return _plot(trace, [*lines, plots.Line("ambient", trace.reference, palette.REFERENCE)], bands)


def _line(trace: Trace, zone: str) -> plots.Line:
    return plots.Line(_ZONES[zone], trace.columns[f"{zone}_degC"], _COLOURS[zone])


def _plot(trace: Trace, lines: Sequence[plots.Line], bands: Sequence[plots.Band] = ()) -> go.Figure:
    return plots.stacked_figure(trace.time_s, [plots.Panel("temperature [°C]", lines, bands, _HEIGHT_PX)])
