"""The pages in a real browser, from a file: no error, no request beyond the folder, nothing wider than the screen."""

import html
import json
import re
import shutil
import subprocess

import pytest

from ambient_trainer.diagnosis.discovery.page import discovery_page
from ambient_trainer.diagnosis.page import diagnosis_page
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.report.page import write_report

QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--no-first-run", "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
LISTEN = """<script>
window.faults = [];
addEventListener("error", (event) => faults.push(String(event.message || event.target.src)), true);
addEventListener("unhandledrejection", (event) => faults.push(String(event.reason)));
for (const level of ["error", "warn"]) console[level] = (...said) => faults.push(said.join(" "));
addEventListener("load", () => setTimeout(() => parent.postMessage(JSON.stringify({
  faults,
  fetched: performance.getEntriesByType("resource").map((each) => each.name),
  wide: document.documentElement.scrollWidth, room: innerWidth,
  plots: [...document.querySelectorAll(".js-plotly-plot")].map(
    (each) => each.querySelector(".nsewdrag").getBoundingClientRect().width),
}), "*"), 3000));
</script>"""
FRAME = """<html><body><pre id="said"></pre><iframe src="{page}" style="width:{width}px;height:900px;border:0"></iframe>
<script>addEventListener("message", (event) => document.getElementById("said").textContent = event.data);</script>
</body></html>"""


@pytest.fixture
def opened(tmp_path):
    """What a page says of itself in a window of some width."""
    if shutil.which("chromium") is None:
        pytest.skip("no chromium to open the page with")

    def open_page(page, width):
        path = write_report(str(tmp_path / "report"), page.replace("<head>", "<head>" + LISTEN, 1))
        frame = tmp_path / "frame.html"
        frame.write_text(FRAME.format(page=f"file://{path}", width=width))
        shown = subprocess.run(
            [
                "chromium", *QUIET, f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1400,1000",
                "--virtual-time-budget=15000", "--dump-dom", f"file://{frame}",
            ],
            capture_output=True, text=True, timeout=120, check=True,
        ).stdout  # fmt: skip
        return json.loads(html.unescape(re.search(r'<pre id="said">(.*?)</pre>', shown, re.DOTALL)[1]))

    return open_page


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize(("which", "plots"), [("diagnosis", 5), ("discovery", 2)])
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
    assert "factor = 0.69 1, onset = 2000 s" in words or "factor = 0.69, onset = 2000 s" in words
    assert "/data/known-good.csv" in words
    assert " degC" not in words
    assert set(re.findall(r'\b(?:src|href|action)="([^"]*)"', page)) == {"plotly.min.js", "data:,"}
    assert page.count("camera_on") > 5


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


def test_text_is_no_markup(made):
    from dataclasses import replace

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
