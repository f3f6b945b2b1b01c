"""The discovery benchmark as a page: what is found, what is taken for what, and how large an effect has to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go  # type: ignore[import-untyped]

from ambient_studies.discovery.figures import (
    LARGE_IN_NOISE,
    confusion,
    detection_by_size,
    false_alarms,
    large_effects,
    pairs_found,
)
from ambient_studies.discovery.outcome import Outcome
from ambient_studies.discovery.summary import causes_table, headline, totals_table
from ambient_trainer.diagnosis.words import duration
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import BLUE, ORANGE, panel_figure, to_markup, with_legend_above

BARS = (("large", 0.90), ("none", 0.95), ("two", 0.75))
"""What is asked of the benchmark: large effects named, nothing found where nothing is, both of two named."""
_CELL_PX = 34


def discovery_page(outcomes: Sequence[Outcome]) -> str:
    """The report on ``outcomes`` as HTML."""
    seconds = [each.seconds for each in outcomes]
    sized = bool(detection_by_size(outcomes))
    return render(
        "discovery.html",
        headline=headline(outcomes),
        facts=[
            ("cases", f"{len(outcomes):,}: {_mix(outcomes)}"),
            ("time", f"{duration(float(np.median(seconds)))} a diagnosis (median), {duration(max(seconds))} at most")
            if seconds
            else ("time", "-"),
        ],
        asked=_asked(outcomes),
        totals=totals_table(outcomes),
        confusion=to_markup(_confusion(outcomes), "confusion") if outcomes else None,
        detection=to_markup(_detection(outcomes), "detection") if sized else None,
        causes=causes_table(outcomes),
        large=f"{LARGE_IN_NOISE:g}",
    )


def _mix(outcomes: Sequence[Outcome]) -> str:
    counts = [sum(len(each.true) == effects for each in outcomes) for effects in range(3)]
    return f"{counts[0]} with nothing hidden, {counts[1]} with one effect, {counts[2]} with two"


def _asked(outcomes: Sequence[Outcome]) -> list[tuple[str, str, str, bool]]:
    """What is asked, what is reached, and whether that is enough; nothing of what has no case."""
    alarms = false_alarms(outcomes)
    reached = {
        "large": (f"large effects named ({LARGE_IN_NOISE:g} times the noise)", large_effects(outcomes).value),
        "none": ("nothing found where nothing is", 1 - alarms.value),
        "two": ("both of two effects named", pairs_found(outcomes).both.value),
    }
    return [
        (reached[key][0], f"{100 * reached[key][1]:.1f} %", f"at least {100 * bar:.0f} %", reached[key][1] >= bar)
        for key, bar in BARS
        if math.isfinite(reached[key][1])
    ]


def _confusion(outcomes: Sequence[Outcome]) -> go.Figure:
    matrix = confusion(outcomes)
    shares = matrix.counts / np.maximum(matrix.counts.sum(axis=1, keepdims=True), 1)
    right = np.array(matrix.true)[:, None] == np.array(matrix.found)
    figure = panel_figure("", "", height_px=150 + 130 + _CELL_PX * len(matrix.true))
    figure.add_heatmap(
        x=list(matrix.found),
        y=list(matrix.true),
        z=np.where(right, shares, -shares),
        text=[[str(count) if count else "" for count in row] for row in matrix.counts.tolist()],
        texttemplate="%{text}",
        customdata=matrix.counts,
        hovertemplate="hidden %{y}, found %{x}: %{customdata} cases<extra></extra>",
        colorscale=[[0, ORANGE], [0.4995, "#fbe9e0"], [0.5, "#ffffff"], [0.5005, "#e4eefb"], [1, BLUE]],
        zmin=-1,
        zmax=1,
        xgap=1,
        ygap=1,
        showscale=False,
    )
    figure.update_xaxes(side="top", tickangle=-90, **_ticks(matrix.found))
    figure.update_yaxes(autorange="reversed", **_ticks(matrix.true))
    figure.update_layout(margin={"l": 10, "r": 6, "t": 10, "b": 10})
    return with_legend_above(figure)


def _ticks(names: Sequence[str]) -> dict[str, Any]:
    """Names in two lines, small: a phone has room for the cells besides."""
    return {
        "tickvals": list(names),
        "ticktext": [name.replace("_", "<br>") for name in names],
        "tickfont": {"size": 11},
        "showgrid": False,
        "automargin": True,
    }


def _detection(outcomes: Sequence[Outcome]) -> go.Figure:
    found = detection_by_size(outcomes)
    sizes = [each.middle for each in found]
    shares = [100 * each.share.value for each in found]
    lows, highs = zip(*(each.share.ci95 for each in found))
    figure = panel_figure("size, in units of the noise", "cause, place and signal right [%]", height_px=400)
    figure.add_scatter(
        x=sizes,
        y=shares,
        mode="lines+markers",
        name="right, with its 95 % interval",
        line={"color": BLUE, "width": 2},
        marker={"size": 9},
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [100 * high - share for high, share in zip(highs, shares)],
            "arrayminus": [share - 100 * low for low, share in zip(lows, shares)],
            "color": BLUE,
            "thickness": 1.3,
        },
        customdata=[[each.share.hits, each.share.cases] for each in found],
        hovertemplate="%{x:.1f} times the noise: %{customdata[0]} of %{customdata[1]}<extra></extra>",
    )
    asked = 100 * dict(BARS)["large"]
    end = max(*sizes, 2 * LARGE_IN_NOISE)
    figure.add_scatter(
        x=[LARGE_IN_NOISE, end],
        y=[asked, asked],
        mode="lines",
        name=f"asked: {asked:.0f} % from {LARGE_IN_NOISE:g} on",
        line={"color": ORANGE, "dash": "dash", "width": 1.6},
        hoverinfo="skip",
    )
    figure.update_xaxes(type="log", tickvals=[0.2, 0.5, 1, 2, 5, 10, 20, 50, 100], hoverformat=".1f")
    figure.update_yaxes(range=[-3, 103])
    return with_legend_above(figure)
