"""What is left out of a line is never a peak, a gap or an end."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.report.plots import broken_at_gaps, envelope, extremes

NAN = float("nan")
VALUES = st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(NAN)), min_size=1, max_size=300)


@given(VALUES, st.integers(6, 60))
def test_the_extremes_stay_and_the_count_is_bounded(values, limit):
    y = np.array(values)
    kept = extremes(y, limit)
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
    high = low + 1.0
    at, lowest, highest = envelope(low, high, limit)
    assert len(at) <= limit
    for start, stop, a, b in zip(at, [*at[1:], len(low)], lowest, highest):
        stretch = low[start:stop][np.isfinite(low[start:stop])]
        assert (np.isnan(a) and np.isnan(b)) if not len(stretch) else (a, b) == (stretch.min(), stretch.max() + 1.0)


def test_a_column_logged_now_and_then_is_one_line_and_an_absence_is_a_hole():
    x = np.arange(100.0)
    y = np.where(x % 10 == 0, x, NAN)
    y[[40, 50, 60]] = NAN
    line_x, line_y = broken_at_gaps(x, y)
    assert line_x.tolist() == [0, 10, 20, 30, 30, 70, 80, 90]
    assert line_y == pytest.approx([0, 10, 20, 30, NAN, 70, 80, 90], nan_ok=True)


def test_nothing_known_is_nothing_drawn():
    line_x, line_y = broken_at_gaps(np.arange(3.0), np.full(3, NAN))
    assert len(line_x) == len(line_y) == 0
