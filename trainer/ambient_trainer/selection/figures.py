"""The plots of a search: error against number of sensors, the sensors' gains, and the circuits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.report.palette import BASELINE, BLUE, GREY, INK, ORANGE, SAND, SENSOR_COLOURS, SKY
from ambient_trainer.report.plots import add_curve, matrix_figure, panel_figure
from ambient_trainer.selection.result import SearchResult, SelectedCircuit

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

_THINNEST_PX, _THICKEST_PX = 1.0, 7.0
_CHECK_COLOURS = tuple(SENSOR_COLOURS[each] for each in (2, 3, 5, 6))


def errors_figure(result: SearchResult) -> go.Figure:
    """Held-out error by number of sensors, and what the same filters score elsewhere."""
    figure = panel_figure("sensors", "error, RMSE [°C]", height_px=460)
    counts = [len(each.sensors) for each in result.sizes]
    errors, ends = [each.rmse_degC for each in result.sizes], [each.fixed.interval_degC for each in result.sizes]
    hover = ["\n".join(each.sensors) for each in result.sizes]
    add_curve(figure, counts, errors, "held out, one standard error", BLUE, width=2.4, ends=ends, hover=hover)
    free = [each.free.rmse_degC for each in result.sizes]
    add_curve(figure, counts, free, f"held out, free-{result.options.order}", BASELINE)
    if result.circuits:
        wired = [each.rmse_degC for each in result.circuits.values()]
        add_curve(figure, list(result.circuits), wired, "held out, best circuit", ORANGE)
    for check, colour in zip(result.checks, _CHECK_COLOURS):
        add_curve(figure, counts, check.fixed, check.name, colour, dash="dot")
    given: dict[str, object] = {"marker": {"symbol": "x", "size": 10, "color": INK}}
    given["hovertemplate"] = "%{y:.3f} °C<br>%{text}<extra></extra>"
    ring = {"marker": {"symbol": "circle-open", "size": 20, "color": BLUE, "line": {"width": 2}}, "hoverinfo": "skip"}
    for name, each, look in (
        ("held out, the given set", result.against, given),
        ("fewest within one standard error", result.recommended, ring),
    ):
        if each is not None:
            place = {"x": [len(each.sensors)], "y": [each.rmse_degC], "text": [", ".join(each.sensors)]}
            figure.add_scatter(**place, name=name, mode="markers", **look)
    figure.update_xaxes(tickvals=counts, hoverformat="d", tickformat="d", range=[min(counts) - 0.4, max(counts) + 0.4])
    figure.update_yaxes(type="log", tickvals=[0.05, 0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20])
    return figure


def gains_figure(result: SearchResult) -> go.Figure:
    """Which sensors are in which set, by their DC gains."""
    names = list(dict.fromkeys(name for each in result.sizes for name in each.sensors))
    gains = [dict(zip(each.sensors, each.dc_gains)) for each in result.sizes]
    return matrix_figure(
        [str(len(each.sensors)) for each in result.sizes],
        names,
        [[each.get(name) for each in gains] for name in names],
        [[f"{each[name]:+.2f}" if name in each else "" for each in gains] for name in names],
        x_title="sensors",
    )


def circuit_figure(selected: SelectedCircuit) -> go.Figure:
    """The circuit: sensors on a ring, what is not measured within it."""
    circuit, topology = selected.circuit, selected.topology
    inner = [AMBIENT] if topology.form == "rise" else list(topology.states)
    places = {**_ring(topology.sensors, 1.0), **_ring(inner, 0.42 if len(inner) > 1 else 0.0)}
    values = {each.name: each.initial for each in circuit.parameters}
    largest = max(1 / values[each.resistance] for each in circuit.edges)
    figure = panel_figure("", "", height_px=340)
    for edge in circuit.edges:
        (x0, y0), (x1, y1) = places[edge.between[0]], places[edge.between[1]]
        share = 1 / values[edge.resistance] / largest
        colour = SAND if AMBIENT in edge.between else GREY
        width = _THINNEST_PX + (_THICKEST_PX - _THINNEST_PX) * math.sqrt(share)
        figure.add_scatter(x=[x0, x1], y=[y0, y1], mode="lines", line={"color": colour, "width": width},
                           hoverinfo="skip", showlegend=False)  # fmt: skip
        figure.add_scatter(x=[(x0 + x1) / 2], y=[(y0 + y1) / 2], mode="markers", marker={"size": 12, "opacity": 0},
                           text=[f"{'-'.join(edge.between)}: {values[edge.resistance]:.3g} K/W"],
                           hovertemplate="%{text}<extra></extra>", showlegend=False)  # fmt: skip
    kinds = {"sensor": [each for each in topology.sensors if each not in topology.states],
             "sensor with a heat capacity": [each for each in topology.states if each in topology.sensors],
             "hidden node": [each for each in topology.states if each not in topology.sensors],
             "ambient": [each for each in inner if each == AMBIENT]}  # fmt: skip
    for (kind, names), colour in zip(kinds.items(), (SKY, BLUE, ORANGE, SAND)):
        if names:
            figure.add_scatter(
                x=[places[name][0] for name in names],
                y=[places[name][1] for name in names],
                mode="markers+text",
                name=kind,
                text=names,
                textposition=["bottom center" if places[name][1] < 0 else "top center" for name in names],
                marker={"size": 16, "color": colour, "line": {"width": 1.5, "color": "white"}},
                hoverinfo="skip",
            )
    figure.update_xaxes(visible=False, range=[-1.5, 1.5])
    figure.update_yaxes(visible=False, range=[-1.35, 1.35])
    figure.update_layout(margin={"l": 4, "r": 4, "t": 30, "b": 4})
    return figure


def _ring(names: Sequence[str], radius: float) -> dict[str, tuple[float, float]]:
    """Places on a circle, the first at the top."""
    angles = [math.pi / 2 + 2 * math.pi * (k + (0.5 if radius < 1 else 0.0)) / len(names) for k in range(len(names))]
    return {name: (radius * math.cos(angle), radius * math.sin(angle)) for name, angle in zip(names, angles)}
