"""A stack of panels: its axes, its units, its shades, curves and matrices; no line loses a peak or a gap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.report import plots
from ambient_trainer.report.plots import Band, Panel, Shade, broken_at_gaps, spans_where, stacked_figure


def test_a_band_is_an_outline_for_each_stretch_that_has_it():
    time_s = np.arange(0.0, 300.0, 60.0)
    low = np.array([1.0, 2.0, np.nan, 3.0, 4.0])
    outline = stacked_figure(time_s, [Panel("a", [], [Band("b", low, low + 10, "#000")])]).data[0]
    assert outline.fill == "toself"
    assert outline.x == pytest.approx([0, 1, 1, 0, np.nan, 3, 4, 4, 3, np.nan], nan_ok=True)
    assert outline.y == pytest.approx([1, 2, 12, 11, np.nan, 3, 4, 14, 13, np.nan], nan_ok=True)


def test_a_shade_spans_to_the_next_sample_and_flickering_is_one_stretch():
    time_s = np.arange(0.0, 6000.0, 60.0)
    flags = np.zeros(100, dtype=bool)
    flags[[10, 11, 12, 50, 99]] = True
    spans = spans_where(time_s, flags)
    figure = stacked_figure(time_s, [Panel("a", [])], [Shade("away", "#f00", spans)])
    assert spans == [(600.0, 780.0), (3000.0, 3060.0), (5940.0, 5940.0)]
    assert [(each.x0, each.x1) for each in figure.layout.shapes] == [(10, 13), (50, 51), (99, 99)]
    assert figure.data[-1].name == "away"
    time_s = np.arange(10_000.0)
    assert spans_where(time_s, np.arange(10_000) % 2 == 0) == [(0.0, 9999.0)]
    assert spans_where(time_s, np.zeros(10_000, dtype=bool)) == []


NAN = float("nan")
VALUES = st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(NAN)), min_size=1, max_size=300)


@given(VALUES, st.integers(6, 60))
def test_the_extremes_stay_and_the_count_is_bounded(values, limit):
    y = np.array(values)
    kept = plots.extremes(y, limit)
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= limit + 2
    assert kept[0] == 0
    assert kept[-1] == len(y) - 1
    if np.isfinite(y).any():
        assert np.nanmin(y[kept]) == np.nanmin(y)
        assert np.nanmax(y[kept]) == np.nanmax(y)
    assert np.isnan(y[kept]).any() == np.isnan(y).any()


@given(VALUES, st.integers(1, 50))
def test_an_envelope_holds_the_whole_band(values, limit):
    low = np.array(values)
    at, lowest, highest = plots.envelope(low, low + 1.0, limit)
    assert len(at) <= limit
    for start, stop, a, b in zip(at, [*at[1:], len(low)], lowest, highest):
        stretch = low[start:stop][np.isfinite(low[start:stop])]
        assert (np.isnan(a) and np.isnan(b)) if not len(stretch) else (a, b) == (stretch.min(), stretch.max() + 1.0)


def test_a_column_logged_now_and_then_is_one_line_an_absence_a_hole_and_nothing_known_nothing():
    x = np.arange(100.0)
    y = np.where(x % 10 == 0, x, NAN)
    y[[40, 50, 60]] = NAN
    line_x, line_y = broken_at_gaps(x, y)
    assert line_x.tolist() == [0, 10, 20, 30, 30, 70, 80, 90]
    assert line_y == pytest.approx([0, 10, 20, 30, NAN, 70, 80, 90], nan_ok=True)
    line_x, line_y = broken_at_gaps(np.arange(3.0), np.full(3, NAN))
    assert len(line_x) == len(line_y) == 0
