"""The benchmark's page in a real browser, and what it says."""

import html
import re

import pytest

from ambient_studies.discovery.page import discovery_page


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_has_nothing_to_complain_of(opened, outcomes, width):
    said = opened(discovery_page(outcomes), width)
    assert said["faults"] == []
    assert said["fetched"] == []  # files are not counted
    assert said["wide"] <= said["room"] == width
    assert len(said["plots"]) == 2
    assert min(said["plots"]) > 0.45 * width


def written(page):
    """The page's own words, without the plots' data."""
    return " ".join(
        html.unescape(re.sub(r"<script.*?</script>|<style.*?</style>|<[^>]+>", " ", page, flags=re.S)).split()
    )


def test_the_benchmark_is_held_against_what_is_asked(outcomes):
    words = written(discovery_page(outcomes))
    assert "96.7 % nothing found where nothing is asked: at least 95 %" in words
    assert "75.0 % both of two effects named asked: at least 75 %" in words
    fewer = [each for each in outcomes if len(each.true) < 2 or not each.correct]
    assert "0.0 % both of two effects named asked: at least 75 %; not reached" in written(discovery_page(fewer))


def test_a_benchmark_of_few_cases_is_a_page(outcomes):
    for some in ([], [each for each in outcomes if not each.true], [each for each in outcomes if len(each.true) == 2]):
        assert "Against what is asked" in written(discovery_page(some))
