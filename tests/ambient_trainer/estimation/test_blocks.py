"""Every sample is held out once, and nothing within the gap teaches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.validation import cut_in_blocks


def segment(count, period_s=1.0):
    return Segment(period_s, np.zeros((1, count)), np.zeros((1, count)))


@given(st.lists(st.integers(20, 400), min_size=1, max_size=4), st.integers(2, 12), st.floats(0, 50))
def test_every_sample_is_held_out_once(lengths, count, gap_s):
    laid = [segment(each, 2.0) for each in lengths]
    if len(lengths) == 1 or count > 1:
        found = cut_in_blocks(laid, count, gap_s, "t.csv")
        for index, length in enumerate(lengths):
            own = [each for each in found if each.segment == index]
            held = np.concatenate([np.arange(each.start, each.stop) for each in own])
            np.testing.assert_array_equal(held, np.arange(length))
            for each in own:
                assert each.first == max(0, each.start - round(gap_s / 2.0))
                assert each.last == min(length, each.stop + round(gap_s / 2.0))


def test_the_gap_defaults_to_a_tenth_of_a_block_and_a_reference_in_one_block_only_is_refused():
    first, second, third = cut_in_blocks([segment(300)], 3, None, "t.csv")
    assert (first.first, first.start, first.stop, first.last) == (0, 0, 100, 110)
    assert (second.first, second.start, second.stop, second.last) == (90, 100, 200, 210)
    assert (third.first, third.start, third.stop, third.last) == (190, 200, 300, 300)
    laid = segment(300)
    laid.outputs[:, 100:] = np.nan
    with pytest.raises(Refused, match="the reference fills less than two blocks"):
        cut_in_blocks([laid], 3, None, "t.csv")
