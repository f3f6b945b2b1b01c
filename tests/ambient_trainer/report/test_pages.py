"""Every kind of page in a real browser, from a disk: on a screen and on a phone, light and dark.

A kind is found by its place: ``samples()`` of a file ``sample_report.py`` among the tests of the package that makes it.
"""

import html
import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ambient_trainer.report import Figure, Report
from ambient_trainer.report.page import page_of, write_report
from ambient_trainer.report.palette import on_dark

TESTS = Path(__file__).parents[2]
PLACES = sorted(str(each.parent.relative_to(TESTS)) for each in TESTS.rglob("sample_report.py"))
assert "ambient_trainer/selection" in PLACES
WIDTHS = {"light": (1280, 390), "dark": (1280,), "print": (718,)}  # of A4 between a browser's margins
QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--no-first-run", "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
SCHEMES = {scheme: f"--blink-settings=preferredColorScheme={int(scheme != 'dark')}" for scheme in WIDTHS}
LISTEN = """<script>
window.faults = [];
addEventListener("error", (event) => faults.push(String(event.message || event.target.src)), true);
addEventListener("unhandledrejection", (event) => faults.push(String(event.reason)));
for (const level of ["error", "warn"]) console[level] = (...words) => faults.push(words.join(" "));
const parts = (colour) => (colour.match(/[\\d.]+/g) || []).map(Number);
const clear = (colour) => { const [r, g, b, a] = parts(colour); return r === undefined || a === 0; };
const luminance = (colour) => {
  const [r, g, b] = parts(colour).map((c) => (c /= 255) <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const behind = (element) => {
  for (let each = element; each; each = each.parentElement) {
    const colour = getComputedStyle(each).backgroundColor;
    if (!clear(colour)) return colour;
  }
  return "rgb(255, 255, 255)";
};
const contrast = (colour, element) => {
  const [a, b] = [luminance(colour), luminance(behind(element))].sort();
  return (b + 0.05) / (a + 0.05);
};
const box = (element) => element.getBoundingClientRect();
const beyond = (text, plot) => {
  const room = box(text.closest(".legend")?.querySelector(".bg") || plot);
  return box(text).left < room.left - 1 || box(text).right > room.right + 1;
};
const over = (plot) => box(plot.querySelector(".main-svg")).bottom > box(plot.parentElement).bottom + 1;
const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
const unreadable = (plot) => {
  const titles = [...plot.querySelectorAll("text[class^=y][class$=title]")];
  const ticks = [...plot.querySelectorAll("[class^=y][class$=tick] text")];
  const cut = [...plot.querySelectorAll("text")].filter((each) => beyond(each, plot));
  const covered = titles.filter((title) => ticks.some((tick) => meet(box(title), box(tick))));
  return [...cut, ...covered, ...[plot].filter(over)].map((each) => each.textContent);
};
const all = (selector) => [...document.querySelectorAll(selector)].filter((each) => each.textContent.trim());
addEventListener("load", () => setTimeout(() => parent.postMessage(JSON.stringify({
  name: decodeURIComponent(location.hash.slice(1)),
  faults,
  fetched: performance.getEntriesByType("resource").map((each) => each.name),
  wide: document.documentElement.scrollWidth, room: innerWidth,
  plots: [...document.querySelectorAll(".js-plotly-plot")].map(
    (each) => each.querySelector(".nsewdrag").getBoundingClientRect().width),
  unreadable: [...document.querySelectorAll(".js-plotly-plot")].flatMap(unreadable),
  contrast: Math.min(
    ...all("h1, h2, h3, p, td, th, dt, dd, li, summary").map((each) => contrast(getComputedStyle(each).color, each)),
    ...all(".js-plotly-plot text").map((each) => contrast(getComputedStyle(each).fill, each))),
}), "*"), 3000));
</script>"""
# It listens before the first page begins: a page that is done while the frame is still read would be missed.
FRAME = """<html><body><pre id="told"></pre><script>const told = {{}};
addEventListener("message", (event) => {{
  const each = JSON.parse(event.data); told[each.name] = each;
  document.getElementById("told").textContent = JSON.stringify(told);
}});</script>{frames}</body></html>"""


def samples(place: str) -> dict[str, Report]:
    sys.path.insert(0, str(TESTS.parent))
    try:
        module = importlib.import_module(".".join(("tests", *Path(place).parts, "sample_report")))
    finally:
        sys.path.remove(str(TESTS.parent))
    made: dict[str, Report] = module.samples()
    return made


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_page_is_whole_readable_and_asks_nobody(scheme, tmp_path):
    if shutil.which("chromium") is None:
        pytest.skip("no chromium to open the pages with")
    reports = {f"{place}/{key}": report for place in PLACES for key, report in samples(place).items()}
    frames = []
    for name, report in reports.items():
        path = Path(write_report(str(tmp_path / name), report))
        page = path.read_text().replace("<head>", "<head>" + LISTEN, 1)
        path.write_text(page.replace("@media print", "@media all") if scheme == "print" else page)
        for width in WIDTHS[scheme]:
            where = f"{path.as_uri()}#{name} {width}"
            frames.append(f'<iframe src="{where}" style="width:{width}px;height:900px;border:0"></iframe>')
    (tmp_path / "frame.html").write_text(FRAME.format(frames="".join(frames)))
    measured = _measure(tmp_path / "frame.html", SCHEMES[scheme], tmp_path / "profile")
    assert set(measured) == {f"{name} {width}" for name in reports for width in WIDTHS[scheme]}
    for key, each in measured.items():
        name, _, width = key.rpartition(" ")
        room = int(width)
        assert (key, each["faults"], each["fetched"]) == (key, [], [])  # files are not counted as fetched
        assert (key, each["room"], len(each["plots"])) == (key, room, len(figures(reports[name])))
        assert each["wide"] <= room, key
        assert (key, each["unreadable"]) == (key, [])
        assert min(each["plots"], default=room) > 0.45 * room, key
        assert each["contrast"] > 3.9, key


def _measure(frame: Path, scheme: str, profile: Path) -> dict[str, Any]:
    """What each page measures of itself, by name and width."""
    shown = subprocess.run(
        ["chromium", *QUIET, scheme, f"--user-data-dir={profile}", "--window-size=1400,1000",
         "--virtual-time-budget=60000", "--dump-dom", frame.as_uri()],
        capture_output=True, text=True, timeout=600, check=True,
    ).stdout  # fmt: skip
    found = re.search(r'<pre id="told">(.*?)</pre>', shown, re.DOTALL)
    assert found
    told: dict[str, Any] = json.loads(html.unescape(found[1]))
    return told


@pytest.mark.parametrize("place", PLACES)
def test_a_page_has_its_title_one_colour_for_dark_each_and_links_to_nothing(place):
    known = {colour for colour, _ in on_dark()} | {"rgb(255, 255, 255)"}
    for report in samples(place).values():
        json.dumps(dict(report.data), allow_nan=False)
        page = page_of(report)
        assert html.unescape(page.split("<h1>")[1].split("</h1>")[0]) == report.title.replace("degC", "°C")
        assert set(re.findall(r'\b(?:src|href|action)="([^"#]*)"', page)) <= {"plotly.min.js", "data:,", ""}
        assert not re.search(r"(?<!\w)degC\b", re.sub(r"<script.*?</script>|<code>.*?</code>", "", page, flags=re.S))
        for figure in figures(report):
            for colour in re.findall(r'"#([0-9a-f]{6})"', figure.draw().to_json(), re.I):
                assert "rgb({}, {}, {})".format(*bytes.fromhex(colour)) in known


def figures(block: Any) -> list[Figure]:
    if isinstance(block, Figure):
        return [block]
    blocks = [*block.lead, *block.sections] if isinstance(block, Report) else getattr(block, "blocks", ())
    return [each for inner in blocks for each in figures(inner)]
