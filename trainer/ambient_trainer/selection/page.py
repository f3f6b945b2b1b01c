"""The search as a page: error against number of sensors, what the sensors weigh, and the circuits that were found."""

from __future__ import annotations

import math
from dataclasses import replace

import plotly.graph_objects as go  # type: ignore[import-untyped]
from markupsafe import Markup

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import (
    BLUE,
    INK,
    ORANGE,
    SAND,
    SENSOR_COLOURS,
    SKY,
    panel_figure,
    to_markup,
    with_legend_above,
)
from ambient_trainer.report.table import Table
from ambient_trainer.selection.found import Found, FoundCircuit
from ambient_trainer.selection.summary import checks_table, left_out_lines, sizes_table, trace_name, verdict

_CELL_PX = 30
_THINNEST_PX, _THICKEST_PX = 1.0, 7.0


def search_page(found: Found) -> str:
    """The page as HTML."""
    return render(
        "search.html",
        facts=_facts(found),
        verdict=[_shown(line) for line in verdict(found)],
        left_out=[_shown(line) for line in left_out_lines(found.left_out)],
        sizes=_table(sizes_table(found)),
        checks=_table(checks_table(found)) if found.checks else None,
        front=to_markup(_front(found), "front"),
        weights=to_markup(_weights(found), "weights"),
        circuits=[
            {"title": _title(each), "plot": _drawn(each, f"circuit-{size}")} for size, each in found.circuits.items()
        ],
    )


def _facts(found: Found) -> list[tuple[str, str | list[str]]]:
    return [
        ("traces", list(found.traces)),
        ("zones", f"{len(found.sensors)} searched, {len(found.left_out)} left out"),
        ("sets of sensors", f"{found.sets_tried:,} scored, one sample every {found.period_s:g} s"),
        ("circuits", f"{sum(each.tried for each in found.circuits.values()):,} fitted, one sample every "
         f"{found.circuit_period_s:g} s" if found.circuits else "not searched"),
        ("sensors' errors", f"as if each had {found.options.tolerance_degC:g} °C more, of noise and at rest"),
    ]  # fmt: skip


def _front(found: Found) -> go.Figure:
    """Held-out error by number of sensors, and what the same filters score elsewhere."""
    figure = panel_figure("sensors", "error, RMSE [°C]", height_px=460)
    counts = [len(each.sensors) for each in found.sizes]
    errors = [each.held_out.rmse_degC for each in found.sizes]
    figure.add_scatter(
        x=counts,
        y=errors,
        mode="lines+markers",
        name="held out, one standard error",
        line={"color": BLUE, "width": 2.4},
        marker={"size": 9},
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [each.held_out.band_degC[1] - each.held_out.rmse_degC for each in found.sizes],
            "arrayminus": [each.held_out.rmse_degC - each.held_out.band_degC[0] for each in found.sizes],
            "color": BLUE,
            "thickness": 1.3,
        },
        text=["<br>".join(each.sensors) for each in found.sizes],
        hovertemplate="%{y:.3f} °C<br>%{text}<extra></extra>",
    )
    free = [each.free.held_out.rmse_degC for each in found.sizes]
    _curve(figure, counts, free, f"held out, free-{found.options.order}", SAND)
    if found.circuits:
        _curve(figure, list(found.circuits), [each.held_out.rmse_degC for each in found.circuits.values()],
               "held out, best circuit", ORANGE)  # fmt: skip
    for check, colour in zip(
        found.checks, (SENSOR_COLOURS[2], SENSOR_COLOURS[3], SENSOR_COLOURS[5], SENSOR_COLOURS[6])
    ):
        _curve(figure, counts, list(check.filters), trace_name(check.path), colour, dash="dot")
    if found.against is not None:
        figure.add_scatter(
            x=[len(found.against.sensors)],
            y=[found.against.held_out.rmse_degC],
            mode="markers",
            name="held out, the given set",
            text=[", ".join(found.against.sensors)],
            hovertemplate="%{y:.3f} °C<br>%{text}<extra></extra>",
            marker={"symbol": "x", "size": 10, "color": INK},
        )
    named = found.sizes[found.named]
    figure.add_scatter(
        x=[len(named.sensors)],
        y=[named.held_out.rmse_degC],
        mode="markers",
        name="fewest within one standard error",
        marker={"symbol": "circle-open", "size": 20, "color": BLUE, "line": {"width": 2}},
        hoverinfo="skip",
    )
    figure.update_xaxes(tickvals=counts, hoverformat="d", tickformat="d", range=[min(counts) - 0.4, max(counts) + 0.4])
    figure.update_yaxes(type="log", tickvals=[0.05, 0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20])
    return with_legend_above(figure)


def _curve(figure: go.Figure, x: list[int], y: list[float], name: str, colour: str, dash: str = "solid") -> None:
    figure.add_scatter(
        x=x,
        y=y,
        mode="lines+markers",
        name=name,
        line={"color": colour, "width": 1.8, "dash": dash},
        marker={"size": 6},
        hovertemplate="%{y:.3f} °C<extra></extra>",
    )


def _weights(found: Found) -> go.Figure:
    """Which sensors are in which set, by their gains at rest."""
    names = list(dict.fromkeys(name for each in found.sizes for name in each.sensors))
    gains = [dict(zip(each.sensors, each.filter.dc_gains)) for each in found.sizes]
    counts = [str(len(each.sensors)) for each in found.sizes]
    largest = max(abs(gain) for each in gains for gain in each.values())
    figure = panel_figure("sensors", "", height_px=110 + _CELL_PX * len(names))
    figure.add_heatmap(
        x=counts,
        y=names,
        z=[[each.get(name) for each in gains] for name in names],
        text=[[f"{each[name]:+.2f}" if name in each else "" for each in gains] for name in names],
        texttemplate="%{text}",
        hovertemplate="%{y}, of %{x}: %{z:.3f}<extra></extra>",
        colorscale=[[0, ORANGE], [0.5, "#ffffff"], [1, SKY]],
        zmin=-largest,
        zmax=largest,
        xgap=2,
        ygap=2,
        showscale=False,
    )
    figure.update_xaxes(type="category", showgrid=False)
    figure.update_yaxes(autorange="reversed", automargin=True, showgrid=False)
    return with_legend_above(figure)


def _title(found: FoundCircuit) -> str:
    return f"{', '.join(found.wiring.sensors)}: {found.held_out.rmse_degC:.2f} °C held out"


def _drawn(found: FoundCircuit, identity: str) -> Markup:
    """The circuit: sensors on a ring, what is not measured within it."""
    circuit = found.circuit
    inner = [AMBIENT] if found.wiring.form == "rise" else list(found.wiring.states)
    places = {**_ring(found.wiring.sensors, 1.0), **_ring(inner, 0.42 if len(inner) > 1 else 0.0)}
    values = {each.name: each.initial for each in circuit.parameters}
    largest = max(1 / values[each.resistance] for each in circuit.edges)
    figure = panel_figure("", "", height_px=340)
    for edge in circuit.edges:
        (x0, y0), (x1, y1) = places[edge.between[0]], places[edge.between[1]]
        share = 1 / values[edge.resistance] / largest
        colour = SAND if AMBIENT in edge.between else "#6b7280"
        width = _THINNEST_PX + (_THICKEST_PX - _THINNEST_PX) * math.sqrt(share)
        figure.add_scatter(x=[x0, x1], y=[y0, y1], mode="lines", line={"color": colour, "width": width},
                           hoverinfo="skip", showlegend=False)  # fmt: skip
        figure.add_scatter(x=[(x0 + x1) / 2], y=[(y0 + y1) / 2], mode="markers", marker={"size": 12, "opacity": 0},
                           text=[f"{'-'.join(edge.between)}: {values[edge.resistance]:.3g} K/W"],
                           hovertemplate="%{text}<extra></extra>", showlegend=False)  # fmt: skip
    kinds = {"sensor": [each for each in found.wiring.sensors if each not in found.wiring.states],
             "sensor with a heat capacity": [each for each in found.wiring.states if each in found.wiring.sensors],
             "hidden node": [each for each in found.wiring.states if each not in found.wiring.sensors],
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
    return to_markup(with_legend_above(figure), identity)


def _ring(names: tuple[str, ...] | list[str], radius: float) -> dict[str, tuple[float, float]]:
    """Places on a circle, the first at the top."""
    angles = [math.pi / 2 + 2 * math.pi * (k + (0.5 if radius < 1 else 0.0)) / len(names) for k in range(len(names))]
    return {name: (radius * math.cos(angle), radius * math.sin(angle)) for name, angle in zip(names, angles)}


def _table(table: Table) -> Table:
    return replace(table, caption=_shown(table.caption))


def _shown(text: str) -> str:
    return text.replace("degC", "°C")
