"""The page in a real browser, and what stands in it."""

from __future__ import annotations

import re

import pytest

from ambient_studies.unit_variation.page import units_page
from ambient_studies.unit_variation.study import Plan, study
from ambient_studies.unit_variation.summary import sentences, units_table


@pytest.fixture(scope="module")
def done(free_model):
    return study(free_model, Plan(3, 1, ("1",), 5.0), 1, lambda *_: None)


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_has_nothing_to_complain_of(opened, done, width):
    said = opened(units_page(done), width)
    assert said["faults"] == []
    assert said["fetched"] == []  # files are not counted
    assert said["room"] == width
    assert said["wide"] <= width
    assert len(said["plots"]) == 2 * 2
    assert min(said["plots"]) > 0.6 * width


def test_the_page_says_what_the_terminal_says(done):
    page = units_page(done)
    text = re.sub(r"\s+", " ", page)
    for sentence in sentences(done):
        shown = sentence.replace("degC", "°C").replace("'", "&#39;")
        assert f"<li>{shown}</li>" in text
    for row in units_table(done).rows:
        assert re.search("".join(f"<td[^>]*>{re.escape(cell)}</td>" for cell in row), page)
    assert "<strong>simulated</strong>" in page
    assert "degC" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert set(re.findall(r'\b(?:src|href|action)="([^"]*)"', page)) == {"plotly.min.js", "data:,"}
