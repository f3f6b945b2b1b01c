"""The page in a real browser, and what stands in it."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from ambient_trainer.selection.page import search_page
from ambient_trainer.selection.screen import LeftOut
from ambient_trainer.selection.summary import checks_table, sizes_table, verdict


@pytest.fixture(scope="module")
def page(found):
    return search_page(replace(found, left_out=(LeftOut("skin_degC", "constant: 25.5 degC all the time"),)))


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_has_nothing_to_complain_of(opened, page, width):
    said = opened(page, width)
    assert said["faults"] == []
    assert said["fetched"] == []
    assert said["room"] == width
    assert said["wide"] <= width
    assert len(said["plots"]) == 2 + 2
    assert min(said["plots"]) > 0.55 * width


def test_the_page_says_what_the_terminal_says(page, found):
    text = re.sub(r"\s+", " ", page)
    for sentence in verdict(found):
        assert sentence.replace("degC", "°C") in text
    for table in (sizes_table(found), checks_table(found)):
        for row in table.rows:
            assert re.search("".join(f"<td[^>]*>{re.escape(cell)}</td>" for cell in row), page)
    assert "Left out: skin: constant: 25.5 °C all the time." in text
    assert "degC" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def test_the_page_links_to_nothing_outside(page):
    assert set(re.findall(r'\b(?:src|href|action)="([^"]*)"', page)) == {"plotly.min.js", "data:,"}


def test_a_search_for_sensors_only_has_no_circuits(found):
    page = search_page(replace(found, circuits={}, checks=(), against=None))
    assert "The best circuit of each size" not in page
    assert "not searched" in page
