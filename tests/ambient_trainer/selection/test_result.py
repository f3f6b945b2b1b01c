"""Held-out error, one-standard-error rule, front and flatness, worked by hand; what the report has of them."""

from dataclasses import replace

import pytest

from ambient_trainer.report import Finding, Table
from ambient_trainer.selection.report import report_of
from ambient_trainer.selection.search import ScoredSystem, SearchResult, flat_from


def held_out(*mean_squares):
    squares = tuple(10 * each for each in mean_squares)
    return ScoredSystem(None, squares, (10.0,) * len(mean_squares), ())


def test_mean_square_and_its_standard_error():
    scored = held_out(1.0, 4.0, 4.0, 7.0)
    assert (scored.mean_square, scored.rmse_degC) == (4.0, 2.0)
    assert scored.standard_error_degC2 == pytest.approx((18 / 3) ** 0.5 / 2)
    low, high = scored.interval_degC
    assert (low**2, high**2) == pytest.approx((4 - scored.standard_error_degC2, 4 + scored.standard_error_degC2))
    assert replace(held_out(1, 9), samples=(10.0, 30.0)).mean_square == 2.5  # long blocks count more


def test_the_fewest_within_one_standard_error_and_where_it_is_flat():
    least = held_out(3.0, 4.0, 5.0)  # 4 and 0.577
    for second, place in ((4.5, 1), (4.6, 2)):
        sizes = (held_out(9.0, 9.0, 9.0), held_out(second, second, second), least)
        assert SearchResult(None, (), 0, sizes, None, {}, (), ()).recommended is sizes[place]
    assert flat_from([3.0, 1.0, 0.99, 0.985], 0.02) == 1
    assert flat_from([3.0, 1.0, 0.99, 0.975], 0.02) == 2


def blocks(report):
    return [block for section in report.sections for block in section.blocks]


def test_the_report_has_a_row_a_size_what_is_left_out_and_circuits_only_where_they_were_searched(found):
    tables = [each for each in blocks(report_of(found)) if isinstance(each, Table)]
    assert [[row[0] for row in each.rows] for each in tables] == [["1", "2 *", "given"]] * 2
    assert tables[0].rows[1][1] == "left, right"
    assert report_of(found).data["front"] == [1, 2]
    assert f"{found.sizes[1].rmse_degC:.2f}" in report_of(found).title
    data = replace(found.data, left_out={"skin_degC": "constant: 25.5 degC all the time"})
    report = report_of(replace(found, data=data))
    texts = [each.text for each in blocks(report) if isinstance(each, Finding)]
    assert [text for text in texts if "skin" in text and "25.5 degC" in text]
    assert report.data["left_out"] == [{"column": "skin_degC", "why": "constant: 25.5 degC all the time"}]
    report = report_of(replace(found, circuits={}, checks=(), against=None))
    assert not [each for each in report.sections if "circuit" in each.title and each.blocks]
    assert [each["circuit"] for each in report.data["sizes"]] == [None, None]
