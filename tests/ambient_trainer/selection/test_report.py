"""The report of a search: what is left out, what is next, and what a search for sensors alone lacks."""

from dataclasses import replace

from ambient_trainer.report import Finding, Table
from ambient_trainer.selection.report import report_of
from ambient_trainer.selection.screen import LeftOut


def blocks(report):
    return [block for section in report.sections for block in section.blocks]


def test_it_has_a_row_a_size_and_the_named_set_on_every_trace(found):
    tables = [each for each in blocks(report_of(found)) if isinstance(each, Table)]
    assert [[row[0] for row in each.rows] for each in tables] == [["1", "2 *", "given"]] * 2
    assert tables[0].rows[1][1] == "left, right"
    assert f"{found.sizes[1].rmse_degC:.2f}" in report_of(found).title


def test_a_zone_left_out_is_named_with_its_reason(found):
    report = report_of(replace(found, left_out=(LeftOut("skin_degC", "constant: 25.5 degC all the time"),)))
    texts = [each.text for each in blocks(report) if isinstance(each, Finding)]
    assert [text for text in texts if "skin" in text and "25.5 degC" in text]
    assert report.data["left_out"] == [{"column": "skin_degC", "why": "constant: 25.5 degC all the time"}]


def test_a_search_for_sensors_only_has_no_circuits(found):
    report = report_of(replace(found, circuits={}, checks=(), against=None))
    assert not [each for each in report.sections if "circuit" in each.title and each.blocks]
    assert [each["circuit"] for each in report.data["sizes"]] == [None, None]
