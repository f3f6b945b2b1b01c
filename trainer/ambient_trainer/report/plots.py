"""Plots: panels one below the other on one time axis that zooms them all, and single panels.

A line of many samples is drawn from fewer, and no peak is lost: of every stretch the lowest and highest stay.
plotly takes half a second to import: the functions that draw import it, and only a page calls them.
"""

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.report.palette import AXIS, DIVERGING, GRID, TEXT
from ambient_trainer.report.structure import Plot

POINTS_PER_LINE = 6000
"""Lines of more samples than this are drawn from the extremes of stretches."""

_HOURS_ABOVE_S = 3 * 3600
_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, "Liberation Sans", sans-serif'
_MARGIN_PX = {"l": 70, "r": 16, "t": 40, "b": 52}
_BETWEEN_PX = 22
_CLEAR = "rgba(0,0,0,0)"
_GAP_STEPS = 2.5


@dataclass(frozen=True)
class Line:
    """A curve of shape (n,); NaN is a gap."""

    name: str
    values: Array
    colour: str
    width: float = 1.6


@dataclass(frozen=True)
class Band:
    """What lies between two curves of shape (n,)."""

    name: str
    low: Array
    high: Array
    colour: str


@dataclass(frozen=True)
class Panel:
    """One plot of the stack; ``title`` names the quantity and its unit, in as many lines as it has."""

    title: str
    lines: Sequence[Line]
    bands: Sequence[Band] = ()
    height_px: int = 230


@dataclass(frozen=True)
class Shade:
    """Stretches of time, in s, that are coloured in every panel."""

    name: str
    colour: str
    spans: Sequence[tuple[float, float]]


def spans_where(time_s: Array, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """The stretches (from, to in s) where ``flags`` (n,) holds, each to the sample after it.

    Stretches less than 1/400 of the whole apart are drawn as one: no screen shows them apart.
    """
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(int))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    spans = list(zip(time_s[starts].tolist(), time_s[np.minimum(stops, len(time_s) - 1)].tolist()))
    nearest = (time_s[-1] - time_s[0]) / 400
    breaks = [0, *(k + 1 for k, (a, b) in enumerate(pairwise(spans)) if b[0] - a[1] > nearest), len(spans)]
    return [(spans[i][0], spans[j - 1][1]) for i, j in pairwise(breaks) if j > i]


def stacked_figure(time_s: Array, panels: Sequence[Panel], shades: Sequence[Shade] = ()) -> Plot:
    """``panels`` over ``time_s`` (n,), with one legend above: what has the same name in several is named once."""
    from plotly.subplots import make_subplots  # type: ignore[import-untyped]

    seconds, unit = (3600.0, "h") if time_s[-1] - time_s[0] > _HOURS_ABOVE_S else (60.0, "min")
    x = time_s / seconds
    inner = sum(panel.height_px for panel in panels) + _BETWEEN_PX * (len(panels) - 1)
    heights = {"vertical_spacing": _BETWEEN_PX / inner, "row_heights": [panel.height_px for panel in panels]}
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, **heights)
    for row, panel in enumerate(panels, start=1):
        _draw_panel(figure, row, panel, x)
    for shade in shades:
        box = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "line": {"width": 0}, "layer": "below"}
        for start_s, stop_s in shade.spans:
            figure.add_shape(**box, x0=start_s / seconds, x1=stop_s / seconds, fillcolor=shade.colour, opacity=0.18)
        marker = {"symbol": "square", "size": 12, "color": shade.colour, "opacity": 0.4}
        figure.add_scatter(x=[None], y=[None], name=wrapped(shade.name), mode="markers", marker=marker, row=1, col=1)
    _style(figure, inner + _MARGIN_PX["t"] + _MARGIN_PX["b"])
    figure.update_xaxes(title_text=f"time [{unit}]", row=len(panels), col=1)
    seen: set[str] = set()
    for trace in figure.data:
        trace.update(legendgroup=trace.name, showlegend=trace.name not in seen)
        seen.add(trace.name)
    return figure


def panel_figure(x_title: str, y_title: str, height_px: int) -> Plot:
    """An empty plot of one panel that is not over time, in the same style."""
    import plotly.graph_objects as go

    figure = go.Figure()
    _style(figure, height_px)
    figure.update_layout(hovermode="closest", margin={**_MARGIN_PX, "t": 30})
    figure.update_xaxes(title_text=_plain(x_title))
    figure.update_yaxes(title_text=_plain(y_title), automargin=True)
    return figure


def add_curve(
    figure: Plot,
    x: Sequence[float],
    y: Sequence[float],
    name: str,
    colour: str,
    *,
    dash: str = "solid",
    width: float = 1.8,
    ends: Sequence[tuple[float, float]] | None = None,
    hover: Sequence[str] | None = None,
) -> None:
    """Points joined by a line, with an interval (low, high) at each point and a line of text to point at."""
    bars = None
    if ends is not None:
        up, down = zip(*((high - value, value - low) for value, (low, high) in zip(y, ends)))
        bars = {"type": "data", "symmetric": False, "array": up, "arrayminus": down, "color": colour, "thickness": 1.3}
    text = None if hover is None else [_plain(each).replace("\n", "<br>") for each in hover]
    template = "%{y:.3f}" + ("" if hover is None else "<br>%{text}") + "<extra></extra>"
    look = {"line": {"color": colour, "width": width, "dash": dash}, "marker": {"size": 6 if ends is None else 9}}
    shown = {"mode": "lines+markers", "name": _plain(name), "text": text, "hovertemplate": template, **look}
    figure.add_scatter(x=list(x), y=list(y), error_y=bars, **shown)


def matrix_figure(
    columns: Sequence[str],
    rows: Sequence[str],
    values: Sequence[Sequence[float | None]],
    texts: Sequence[Sequence[str]],
    x_title: str = "",
    cell_px: int = 30,
) -> Plot:
    """Cells of text, blue where ``values`` (rows, columns) are above 0 and orange below; None is an empty cell."""
    largest = max((abs(value) for row in values for value in row if value is not None), default=1.0) or 1.0
    figure = panel_figure(x_title, "", height_px=110 + cell_px * len(rows))
    written = {"text": texts, "texttemplate": "%{text}", "textfont": {"color": TEXT}}
    coloured = {"z": values, "colorscale": DIVERGING, "zmin": -largest, "zmax": largest, "showscale": False}
    places = {"x": list(map(_plain, columns)), "y": list(map(_plain, rows)), "xgap": 2, "ygap": 2}
    hover = "%{y}, %{x}: %{text}<extra></extra>"
    figure.add_heatmap(**places, **written, **coloured, hovertemplate=hover)
    figure.update_xaxes(type="category", showgrid=False)
    figure.update_yaxes(autorange="reversed", showgrid=False)
    return figure


def extremes(values: Array, limit: int) -> NDArray[np.intp]:
    """The indices to draw of ``values`` (n,): at most ``limit`` + 2, ascending; all where n <= ``limit``.

    They are the first, the last, and of each of ``limit`` / 3 equal stretches the lowest, the highest and one missing
    value (NaN), so that gaps stay visible.
    """
    if len(values) <= limit:
        return np.arange(len(values))
    size = -(-len(values) // (limit // 3))
    padded = np.concatenate([values, np.full(-len(values) % size, values[-1])]).reshape(-1, size)
    missing = np.isnan(padded)
    picks = (
        np.where(missing, np.inf, padded).argmin(axis=1),
        np.where(missing, -np.inf, padded).argmax(axis=1),
        np.where(missing.any(axis=1), missing.argmax(axis=1), 0),
    )
    starts = np.arange(len(padded)) * size
    kept = np.concatenate([[0], *(starts + pick for pick in picks), [len(values) - 1]])
    return np.unique(np.minimum(kept, len(values) - 1)).astype(np.intp)


def envelope(low: Array, high: Array, limit: int) -> tuple[NDArray[np.intp], Array, Array]:
    """Where to draw a band of shape (n,), and its ends there: the widest of each of at most ``limit`` stretches.

    A stretch without any value gives NaN.
    """
    size = -(-len(low) // limit)
    starts = np.arange(0, len(low), size)
    return starts, np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def broken_at_gaps(x: Array, y: Array) -> tuple[Array, Array]:
    """The samples that have a value, with a NaN wherever more than two are missing in a row.

    A column logged every tenth row is so drawn as a line, and a sensor that was away for a while with a hole.
    """
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 2:
        return x, y
    steps = np.diff(x)
    after = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1
    return np.insert(x, after, x[after - 1]), np.insert(y, after, np.nan)


def to_markup(figure: Plot, identity: str) -> Markup:
    """``figure`` as an element with the id ``identity``, for a page that has loaded plotly's script."""
    config = {
        "displaylogo": False,
        "responsive": True,
        # logged data should not be a click away from somebody's cloud
        "plotlyServerURL": "",
        "modeBarButtonsToRemove": ["select2d", "lasso2d", "sendChartToCloud"],
    }
    return Markup(figure.to_html(include_plotlyjs=False, full_html=False, div_id=identity, config=config))


def _draw_panel(figure: Plot, row: int, panel: Panel, x: Array) -> None:
    place = {"row": row, "col": 1}
    for band in panel.bands:
        outline_x, outline_y = _outline(x, band)
        look = {"mode": "lines", "line": {"width": 0}, "fill": "toself", "fillcolor": band.colour, "opacity": 0.35}
        figure.add_scatter(x=outline_x, y=outline_y, name=_plain(band.name), hoverinfo="skip", **look, **place)
    for line in panel.lines:
        line_x, line_y = broken_at_gaps(x, line.values)
        kept = extremes(line_y, POINTS_PER_LINE)
        points = {"x": line_x[kept].astype(np.float64), "y": line_y[kept].astype(np.float32)}
        look = {"mode": "lines", "line": {"color": line.colour, "width": line.width}}
        figure.add_scatter(**points, name=wrapped(line.name), **look, **place)
    figure.update_yaxes(title_text=_plain(panel.title).replace("\n", "<br>"), **place)


def _outline(x: Array, band: Band) -> tuple[Array, Array]:
    """The band as closed outlines, one for each stretch without a gap, NaN between them."""
    at, low, high = envelope(band.low, band.high, POINTS_PER_LINE // 2)
    known = np.flatnonzero(np.isfinite(low) & np.isfinite(high))
    parts = [part for part in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(part)]
    xs = [np.concatenate([x[at[part]], x[at[part]][::-1], [np.nan]]) for part in parts]
    ys = [np.concatenate([low[part], high[part][::-1], [np.nan]]) for part in parts]
    return (np.concatenate(xs), np.concatenate(ys).astype(np.float32)) if parts else (np.empty(0), np.empty(0))


def _style(figure: Plot, height_px: int) -> None:
    """One look, with the legend in rows above and no buttons: narrow screens have no room beside a plot."""
    axis = {"gridcolor": GRID, "linecolor": AXIS, "zerolinecolor": AXIS, "showline": True}
    figure.update_xaxes(**axis, ticks="outside", tickcolor=AXIS, hoverformat=".3f", zeroline=False, title_font_size=12)
    figure.update_yaxes(**axis, hoverformat=".2f", title={"standoff": 4, "font_size": 12})
    figure.update_layout(
        template="none",
        height=height_px,
        margin=_MARGIN_PX,
        font={"family": _FONT, "size": 13, "color": TEXT},
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom", "font": {"size": 12}},
        modebar={"remove": ["zoom", "pan", "zoomIn", "zoomOut", "autoScale", "resetScale", "toImage"]},
        hovermode="x unified",
        hoverlabel={"bgcolor": "white", "bordercolor": AXIS},
        plot_bgcolor=_CLEAR,
        paper_bgcolor=_CLEAR,
    )


def wrapped(text: str) -> str:
    """``text`` as it stands, in lines that a phone is wide enough for."""
    return "<br>".join(map(_plain, textwrap.wrap(text, 36)))


def _plain(text: str) -> str:
    """Text that plotly shows as it stands: it takes a few tags and links in labels for markup."""
    return html.escape(text, quote=False)
