"""The page in a real browser, from a file: no error, no request beyond its folder, nothing wider than the screen."""

import html
import json
import re
import shutil
import subprocess

import pytest

from ambient_trainer.report.page import write_report
from ambient_trainer.reproduce.page import reproduction_page
from ambient_trainer.thesis.errata import text_errata

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
  plots: [...document.querySelectorAll(".js-plotly-plot .subplot")].map(
    (each) => each.closest(".js-plotly-plot").querySelector(".nsewdrag").getBoundingClientRect().width),
}), "*"), 3000));
</script>"""
FRAME = """<html><body><pre id="said"></pre><iframe src="{page}" style="width:{width}px;height:900px;border:0"></iframe>
<script>addEventListener("message", (event) => document.getElementById("said").textContent = event.data);</script>
</body></html>"""


@pytest.fixture
def page(made):
    return reproduction_page(made(), text_errata())


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
                "chromium",
                *QUIET,
                f"--user-data-dir={tmp_path / 'profile'}",
                "--window-size=1400,1000",
                "--virtual-time-budget=15000",
                "--dump-dom",
                f"file://{frame}",
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        ).stdout
        return json.loads(html.unescape(re.search(r'<pre id="said">(.*?)</pre>', shown, re.DOTALL)[1]))

    return open_page


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
