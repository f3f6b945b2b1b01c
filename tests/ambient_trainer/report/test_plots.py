"""A stack of panels: its axes, its units, its shades."""

import numpy as np
import pytest

from ambient_trainer.report.plots import Band, Line, Panel, Shade, spans_where, stacked_figure, time_axis


@pytest.mark.parametrize(("last_s", "unit"), [(600.0, "min"), (3 * 3600.0, "min"), (3 * 3600.0 + 1, "h")])
def test_the_time_axis_has_the_unit_that_fits(last_s: float, unit: str) -> None:
    assert time_axis(np.array([0.0, last_s]))[1] == unit


def test_the_panels_share_one_time_axis_in_its_unit() -> None:
    time_s = np.arange(0.0, 601.0, 60.0)
    panels = [Panel("a [°C]", [Line("one", time_s, "#000")]), Panel("b [W]", [Line("two", -time_s, "#000")])]

    figure = stacked_figure(time_s, panels)

    assert figure.layout.xaxis.matches == "x2"
    assert figure.layout.xaxis2.title.text == "time [min]"
    assert (figure.layout.yaxis.title.text, figure.layout.yaxis2.title.text) == ("a [°C]", "b [W]")
    assert figure.data[0].x.tolist() == list(range(11))
    assert [each.yaxis for each in figure.data] == ["y", "y2"]


def test_a_band_is_an_outline_for_each_stretch_that_has_it() -> None:
    time_s = np.arange(0.0, 300.0, 60.0)
    low = np.array([1.0, 2.0, np.nan, 3.0, 4.0])

    figure = stacked_figure(time_s, [Panel("a", [], [Band("b", low, low + 10, "#000")])])

    outline = figure.data[0]
    assert outline.fill == "toself"
    assert outline.x == pytest.approx([0, 1, 1, 0, np.nan, 3, 4, 4, 3, np.nan], nan_ok=True)
    assert outline.y == pytest.approx([1, 2, 12, 11, np.nan, 3, 4, 14, 13, np.nan], nan_ok=True)


def test_long_lines_are_thinned_and_keep_their_peak() -> None:
    time_s = np.arange(100_000.0)
    values = np.zeros(100_000)
    values[77_777] = 5.0

    figure = stacked_figure(time_s, [Panel("a", [Line("one", values, "#000")])])

    assert len(figure.data[0].y) < 6_010
    assert figure.data[0].y.max() == 5.0


def test_a_shade_spans_to_the_next_sample_in_the_units_of_the_axis() -> None:
    time_s = np.arange(0.0, 6000.0, 60.0)
    flags = np.zeros(100, dtype=bool)
    flags[[10, 11, 12, 50, 99]] = True

    spans = spans_where(time_s, flags)
    figure = stacked_figure(time_s, [Panel("a", [])], [Shade("away", "#f00", spans)])

    assert spans == [(600.0, 780.0), (3000.0, 3060.0), (5940.0, 5940.0)]
    assert [(each.x0, each.x1) for each in figure.layout.shapes] == [(10, 13), (50, 51), (99, 99)]
    assert figure.data[-1].name == "away"


def test_flickering_is_shaded_as_one_stretch() -> None:
    time_s = np.arange(10_000.0)

    assert spans_where(time_s, np.arange(10_000) % 2 == 0) == [(0.0, 9999.0)]
    assert spans_where(time_s, np.zeros(10_000, dtype=bool)) == []


def test_names_are_shown_as_they_stand() -> None:
    figure = stacked_figure(np.arange(3.0), [Panel("a", [Line('<a href="x">y</a>', np.arange(3.0), "#000")])])

    assert figure.data[0].name == '&lt;a href="x"&gt;y&lt;/a&gt;'


def test_one_legend_names_what_stands_in_several_panels_once() -> None:
    """Beside the panels it would leave them a quarter of a phone's width."""
    one, two = np.arange(3.0), -np.arange(3.0)
    panels = [
        Panel("a", [Line("measured", one, "#000")]),
        Panel("b", [Line("measured", two, "#000"), Line("simulated", one, "#111")]),
    ]

    figure = stacked_figure(np.arange(3.0), panels)

    assert [(each.name, each.showlegend) for each in figure.data] == [
        ("measured", True),
        ("measured", False),
        ("simulated", True),
    ]
    assert {each.legend for each in figure.data} == {None}
    assert (figure.layout.legend.orientation, figure.layout.legend.yanchor) == ("h", "bottom")
