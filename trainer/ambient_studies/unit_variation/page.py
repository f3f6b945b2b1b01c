"""The study as a page: how far off the model is on every unit, before and after its correction."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go  # type: ignore[import-untyped]
from markupsafe import Markup

from ambient_studies.unit_variation.study import Study
from ambient_studies.unit_variation.summary import WAYS, Group, figures, groups, scatter, sentences, units_table
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import BLUE, INK, ORANGE, panel_figure, to_markup, with_legend_above

_HEIGHT_PX = 330
_COLOURS = (ORANGE, BLUE)


def units_page(study: Study) -> str:
    """The page as HTML."""
    plan = study.plan
    return render(
        "units.html",
        facts=[
            ("model", f"{study.model.name}, reads {', '.join(each.name for each in study.model.main.inputs)}"),
            ("units", f"{len(study.units)} simulated ones, drawn from seed {plan.seed}, and the nominal one"),
            ("weather", "the same for all; a calibration has its own"),
            ("samples", f"one every {plan.period_s:g} s"),
        ],
        sentences=sentences(study),
        table=units_table(study),
        groups=[
            {
                "title": f"Scenario {group.scenario}, {group.dress}",
                "plots": [_ranked(study, group, f"rmse-{index}"), _biases(study, group, f"bias-{index}")],
            }
            for index, group in enumerate(groups(study))
        ],
    )


def _ranked(study: Study, group: Group, identity: str) -> Markup:
    """The RMSE of all units, the best first: which share of them is better than a given error."""
    figure = panel_figure("share of units that are better [%]", "RMSE [°C]", _HEIGHT_PX)
    for way, colour in zip(WAYS, _COLOURS):
        values = figures(study, group, way.rmse_degC)
        order = np.argsort(values)
        figure.add_scatter(
            x=100 * (np.arange(len(values)) + 0.5) / len(values),
            y=np.array(values)[order],
            text=[f"unit {study.units[index].number}" for index in order],
            name=way.name,
            mode="lines+markers",
            line={"color": colour, "width": 1.2, "shape": "hv"},
            marker={"size": 5},
            hovertemplate="%{text}: %{y:.2f} °C",
        )
    trained = scatter(study, group, WAYS[0].rmse_degC).nominal
    _level(figure, trained, "the unit it was trained on")
    figure.update_yaxes(rangemode="tozero")
    figure.update_xaxes(range=[0, 100])
    return to_markup(with_legend_above(figure), identity)


def _biases(study: Study, group: Group, identity: str) -> Markup:
    """Each unit's bias over the run with its correction against the one without: at the height of 0 it is mended."""
    figure = panel_figure("bias as it is [°C]", "bias corrected [°C]", _HEIGHT_PX)
    before, after = (way.bias_degC for way in WAYS)
    x, y = figures(study, group, before), figures(study, group, after)
    edge = 1.1 * max(*map(abs, x), *map(abs, y), 0.1)
    figure.add_scatter(
        x=[-edge, edge],
        y=[-edge, edge],
        name="as before",
        mode="lines",
        hoverinfo="skip",
        line={"color": "#9ca3af", "dash": "dot", "width": 1.4},
    )
    figure.add_scatter(
        x=x,
        y=y,
        text=[f"unit {each.number}" for each in study.units],
        name="a unit",
        mode="markers",
        marker={"color": BLUE, "size": 8, "line": {"width": 0.6, "color": "white"}},
        hovertemplate="%{text}: %{x:.2f}, corrected %{y:.2f} °C",
    )
    trained = study.nominal.scores[groups(study).index(group)]
    figure.add_scatter(
        x=[before(trained)],
        y=[after(trained)],
        name="the unit it was trained on",
        mode="markers",
        marker={"color": INK, "size": 11, "symbol": "diamond"},
        hovertemplate="%{x:.2f}, corrected %{y:.2f} °C",
    )
    return to_markup(with_legend_above(figure), identity)


def _level(figure: go.Figure, value: float, name: str) -> None:
    figure.add_scatter(
        x=[0, 100],
        y=[value, value],
        name=name,
        mode="lines",
        hovertemplate="%{y:.2f} °C",
        line={"color": INK, "dash": "dash", "width": 1.4},
    )
