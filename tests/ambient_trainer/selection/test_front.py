"""Front, one-standard-error rule and flatness, worked by hand."""

from __future__ import annotations

import pytest

from ambient_trainer.selection.front import HeldOut, fewest_within_one_error, flat_from, pareto_front


def held_out(*mean_squares):
    return HeldOut(tuple(10 * each for each in mean_squares), (10.0,) * len(mean_squares))


def test_mean_square_and_its_standard_error():
    found = held_out(1.0, 4.0, 4.0, 7.0)
    assert found.mean_square == 4.0
    assert found.rmse_degC == 2.0
    assert found.standard_error_degC2 == pytest.approx((18 / 3) ** 0.5 / 2)
    low, high = found.band_degC
    assert low**2 == pytest.approx(4 - found.standard_error_degC2)
    assert high**2 == pytest.approx(4 + found.standard_error_degC2)


def test_long_blocks_count_more():
    assert HeldOut((10.0, 90.0), (10.0, 30.0)).mean_square == 2.5


def test_the_fewest_within_one_standard_error_of_the_least():
    least = held_out(3.0, 4.0, 5.0)  # 4 and 0.577
    assert fewest_within_one_error([held_out(9.0, 9.0, 9.0), held_out(4.5, 4.5, 4.5), least]) == 1
    assert fewest_within_one_error([held_out(9.0, 9.0, 9.0), held_out(4.6, 4.6, 4.6), least]) == 2


def test_the_front_holds_what_no_smaller_one_beats():
    assert pareto_front([3.0, 2.0, 2.0, 2.5, 1.0]) == [0, 1, 4]


def test_flat_is_where_nothing_further_gains():
    assert flat_from([3.0, 1.0, 0.99, 0.985], 0.02) == 1
    assert flat_from([3.0, 1.0, 0.99, 0.975], 0.02) == 2
