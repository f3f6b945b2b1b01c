"""The pages in a real browser, from a file: no error, no request beyond the folder, nothing wider than the screen."""

import html
import re
from dataclasses import replace

import pytest

from ambient_studies.discovery.page import discovery_page
from ambient_trainer.diagnosis.page import diagnosis_page
from ambient_trainer.diagnosis.result import Cause


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize(("which", "plots"), [("diagnosis", 9), ("discovery", 2)])
def test_a_browser_has_nothing_to_complain_of(opened, made, outcomes, which, plots, width):
    said = opened(diagnosis_page(made()) if which == "diagnosis" else discovery_page(outcomes), width)

    assert said["faults"] == []
    assert said["fetched"] == []  # files are not counted
    assert said["room"] == width
    assert said["wide"] <= width
    assert len(said["plots"]) == plots
    assert min(said["plots"]) > 0.45 * width


def written(page):
    """The page's own words, without the plots' data."""
    return " ".join(
        html.unescape(re.sub(r"<script.*?</script>|<style.*?</style>|<[^>]+>", " ", page, flags=re.S)).split()
    )


def test_the_page_says_what_was_found_and_what_was_not(made):
    page = diagnosis_page(made())
    words = written(page)

    assert words.index("Heat that the circuit does not know, at flash, driven by camera_on") < words.index("confidence")
    assert "0.820 W (0.780 to 0.860 W): heat into flash while camera_on is 1" in words
    assert "explains the same with more parameters" in words
    assert "Next experiment: switch camera_on on for 20 min and off for 20 min" in words
    assert "temperatures alone cannot tell the scale in W" in words
    assert "factor = 0.69, onset = 2000 s" in words
    assert "/data/known-good.csv" in words
    assert " degC" not in words
    assert set(re.findall(r'\b(?:src|href|action)="([^"]*)"', page)) == {"plotly.min.js", "data:,"}
    assert page.count("camera_on") > 5


def test_what_stands_between_backquotes_is_code_and_no_markup(made):
    page = diagnosis_page(made(next_experiment="Hold `<b>_on` at 1 `degC"))
    assert "<li>Next experiment: Hold <code>&lt;b&gt;_on</code> at 1 `degC</li>" in page


def test_beneath_the_heat_stands_what_drives_the_causes_or_all_that_varies(made):
    driven = diagnosis_page(made())
    assert "Beneath it, what drives the causes found." in driven
    assert '"camera\\u003cbr\\u003e[0 or 1]"' in driven
    assert "cpu_load\\u003c" not in driven
    first, second = made().steps
    told = replace(first, cause=Cause("contact", "flash"))
    idle = {**made().signals, "charging_on": 0 * made().time_s}
    free = diagnosis_page(made(steps=(told, second), verdict=told, signals=idle))
    assert "Beneath it, what was logged besides and varies." in free
    assert '"cpu_load\\u003cbr\\u003e[fraction]"' in free
    assert "charging\\u003c" not in free


def test_the_found_window_is_shaded(made):
    page = diagnosis_page(made())
    # 3600 to 5400 s of a trace drawn in minutes, in each of the four plots over time
    assert len(re.findall(r'"x0":60\.0,"x1":90\.0|"x1":90\.0[^}]*"x0":60\.0', page)) == 4


def test_nothing_found_is_a_page_too(made):
    diagnosis = made(steps=(), verdict=None, ranking=(), next_experiment="")
    words = written(diagnosis_page(diagnosis))
    assert "Nothing is missing" in words
    assert "What else was tried" not in words
    assert "What was found" not in words


def test_an_unknown_misfit_is_no_finding(made):
    step = replace(
        made().steps[0], cause=Cause("unknown"), magnitude=None, sentence="It is 0.91 degC off.",
        indistinguishable_from=(),
    )  # fmt: skip
    page = diagnosis_page(made(steps=(step,), verdict=step))
    words = written(page)
    assert words.count("It is 0.91 °C off.") == 1
    for told in ("What was found", "RMSE with every step", "confidence"):
        assert told not in words
    assert "with the causes found" not in page
    assert 'id="gains"' not in page
    assert "What would tell more Next experiment: switch camera_on" in words


def test_text_is_no_markup(made):
    step = replace(
        made().steps[0], cause=Cause("heat_source", "<b>fl</b>", "<i>x</i>_on"), sentence="<script>1</script>"
    )
    page = diagnosis_page(made(steps=(step,), verdict=step, notes=("<img src=x>",)))
    for tag in ("<b>fl</b>", "<i>x</i>", "<script>1", "<img src=x>"):
        assert tag not in page


def test_the_benchmark_is_held_against_what_is_asked(outcomes):
    words = written(discovery_page(outcomes))
    assert "96.7 % nothing found where nothing is asked: at least 95 %" in words
    assert "75.0 % both of two effects named asked: at least 75 %" in words
    fewer = [each for each in outcomes if len(each.true) < 2 or not each.correct]
    assert "0.0 % both of two effects named asked: at least 75 %; not reached" in written(discovery_page(fewer))


def test_a_benchmark_of_few_cases_is_a_page(outcomes):
    for some in ([], [each for each in outcomes if not each.true], [each for each in outcomes if len(each.true) == 2]):
        assert "Against what is asked" in written(discovery_page(some))
