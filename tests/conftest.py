"""Property tests that draw the same examples every time; the command line, model files, and pages in a real browser."""

from __future__ import annotations

import html
import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from ambient_model.model import Model

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # tests that run in a shell's background are deaf to Ctrl-C, and so would be every program that they start
    signal.signal(signal.SIGINT, signal.default_int_handler)

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
def trainer(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, str, str]]:
    """Runs ``ambient-trainer`` with arguments and returns its status, its output and its messages."""

    from ambient_trainer.cli.main import main  # the device's tests should not wait for it

    def run(*arguments: object) -> tuple[Any, str, str]:
        monkeypatch.setattr(sys, "argv", ["ambient-trainer", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
        return (stopped.value.code, *capsys.readouterr())

    return run


@pytest.fixture
def saved(tmp_path: Path) -> Callable[[Model], str]:
    """Writes a model and returns its path."""

    from ambient_model.codec import save_model

    def save(model: Model) -> str:
        path = str(tmp_path / "model.json")
        save_model(path, model)
        return path

    return save


@pytest.fixture
def opened(tmp_path: Path) -> Callable[[str, int], dict[str, Any]]:
    """What a page says of itself in a window of some width."""
    if shutil.which("chromium") is None:
        pytest.skip("no chromium to open the page with")

    from ambient_trainer.report.page import write_report

    def open_page(page: str, width: int) -> dict[str, Any]:
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
        found = re.search(r'<pre id="said">(.*?)</pre>', shown, re.DOTALL)
        assert found
        said: dict[str, Any] = json.loads(html.unescape(found[1]))
        return said

    return open_page
