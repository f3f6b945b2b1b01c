"""Which poles are offered; what they make of a trace is held in test_grams."""

from __future__ import annotations

import pytest

from ambient_trainer.selection.grams import banks


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_every_bank_is_shown_often_enough_by_the_trace(order):
    found = banks(order, 1.0, 20_000.0)
    assert len(set(found)) == len(found) >= 4
    assert all(len(each) == order and each[-1] <= 1000 and list(each) == sorted(each) for each in found)


def test_a_short_trace_gets_the_fastest_bank():
    assert banks(4, 1.0, 100.0) == [(1.0, 3.0, 9.0, 27.0)]
