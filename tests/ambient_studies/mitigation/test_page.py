"""The page in a real browser, and what stands in it."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from ambient_studies.mitigation.comparison import Comparison
from ambient_studies.mitigation.page import mitigation_page
from ambient_studies.mitigation.score import score_table, scores, verdict


@pytest.fixture(scope="module")
def page(model, identified, setting, records):
    return mitigation_page(Comparison(model, identified, setting, tuple(records)))


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_has_nothing_to_complain_of(opened, page, width):
    said = opened(page, width)
    assert said["faults"] == []
    assert said["fetched"] == []  # files are not counted
    assert said["room"] == width
    assert said["wide"] <= width
    assert len(said["plots"]) == 3 * 3
    assert min(said["plots"]) > 0.6 * width


def test_the_page_says_what_the_terminal_says(page, setting, records):
    found = scores(records, setting)
    text = re.sub(r"\s+", " ", page)
    for sentence in verdict(found, setting):
        assert f"<li>{sentence.replace('degC', '°C')}</li>" in text
    for row in score_table(found, setting).rows:
        cells = "".join(f"<td[^>]*>{re.escape(cell.replace('degC', '°C'))}</td>" for cell in row)
        assert re.search(cells, page)
    assert "<strong>simulated</strong>" in page
    assert "degC" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def test_the_page_links_to_nothing_outside(page):
    assert set(re.findall(r'\b(?:src|href|action)="([^"]*)"', page)) == {"plotly.min.js", "data:,"}


def test_a_change_of_air_is_said(model, identified, setting, records):
    still = replace(setting, convection_W_m2_K125=2.8)
    assert "of convection 2.8 W/(m² K^1.25), model and governor come from the chamber" in mitigation_page(
        Comparison(model, identified, still, tuple(records))
    )
