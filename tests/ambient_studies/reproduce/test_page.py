"""The page in a real browser, from a file: no error, no request beyond its folder, nothing wider than the screen."""

import re

import pytest

from ambient_studies.reproduce.page import reproduction_page
from ambient_studies.thesis.errata import text_errata


@pytest.fixture
def page(made):
    return reproduction_page(made(), text_errata())


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_has_nothing_to_complain_of(opened, page, width):
    said = opened(page, width)

    assert said["faults"] == []
    assert said["fetched"] == []  # files are not counted
    assert said["room"] == width
    assert said["wide"] <= width
    # the scatter, 4.1, 4.5, 5.1 to 5.9
    assert len(said["plots"]) == 12
    assert min(said["plots"]) > 0.6 * width


def test_the_listener_hears(opened):
    bad = """<head></head><body><div style="width:2000px">wide</div><script>console.error("spoken");</script>
    <script src="missing.js"></script><img src="http://nowhere.invalid/a.png"><script>undefined_here();</script>"""
    said = opened(bad, 390)
    assert said["wide"] > 390
    assert said["fetched"] == ["http://nowhere.invalid/a.png"]
    for fault in ("spoken", "missing.js", "a.png", "undefined_here"):
        assert any(fault in each for each in said["faults"])


def test_the_page_links_to_nothing_outside(page):
    targets = set(re.findall(r'\b(?:src|href|action)="([^"]*)"', page))
    assert {each for each in targets if not each.startswith("#")} == {"plotly.min.js", "data:,"}
    for anchor in targets:
        if anchor.startswith("#"):
            assert f'id="{anchor[1:]}"' in page


def test_every_figure_and_table_is_there(page):
    for number in ("4.1", "4.5", *(f"5.{k}" for k in range(1, 10))):
        assert f"<h2>Figure {number}:" in page
    for number in range(1, 13):
        assert f"Table 5.{number}:" in page
    for erratum in text_errata():
        assert f"<h3>Erratum {erratum.number}: " in page
    assert "simulated</strong> phone" in page
    assert "degC" not in re.sub(r"<script.*?</script>|<div[^>]*class=\"plotly.*?</div>", "", page, flags=re.DOTALL)
