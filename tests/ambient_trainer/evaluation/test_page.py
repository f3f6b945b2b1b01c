"""The page in a real browser, from a file, with no network."""

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambient_model.model import Model
from ambient_trainer.data.trace import Trace
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.evaluation.page import evaluation_page
from ambient_trainer.evaluation.summary import figures_table
from ambient_trainer.report.page import write_report

BASELINE = {"kind": "static linear", "gains": {"usb": 1.25, "battery": -0.3}, "offset": 0.5}
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND",
]


def shown(page: str, profile: Path) -> str:
    """The document after its scripts ran."""
    done = subprocess.run(
        [
            "chromium",
            *QUIET,
            f"--user-data-dir={profile}",
            "--window-size=1400,2400",
            "--virtual-time-budget=8000",
            "--dump-dom",
            f"file://{page}",
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium to open the page with")
def test_a_browser_draws_every_plot_and_asks_nobody(
    model_of: Callable[..., Model], trace_of: Callable[..., Trace], tmp_path: Path
) -> None:
    model = model_of({"circuit": "two & <one>", "baseline": BASELINE})
    holed = trace_of(30_000)
    holed.columns["usb_degC"][9_000:9_200] = np.nan
    evaluations = [
        evaluate_trace(model, replace(trace, path=name)) for trace, name in ((holed, "a"), (trace_of(500), "b"))
    ]

    dom = shown(write_report(str(tmp_path / "report"), evaluation_page(model, evaluations)), tmp_path / "profile")

    for number in (1, 2):
        plot = dom.split(f'id="trace-{number}"')[1].split("</section>")[0]
        assert "main-svg" in plot
        assert len(re.findall(r'class="subplot x\d?y\d?"', plot)) == 3
        assert plot.count("js-line") >= 6  # reference, estimate, baseline, error and two sensors
        assert "ambient [°C]" in plot
    assert "time [h]" in dom
    assert "time [min]" in dom
    assert "coasting" in dom
    assert "faulted" in dom
    assert "two &amp; &lt;one&gt;" in dom
    for row in figures_table(evaluations).rows:
        for cell in row:
            assert f">{cell}</td>" in dom
    assert "Share chart" not in dom
    assert set(re.findall(r'\b(?:src|href|action)="([^"]*)"', dom)) == {"plotly.min.js", "data:,"}
    assert set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+", dom)) == {"http://www.w3.org"}  # names of XML vocabularies


def test_a_hostile_name_stays_text(model_of: Callable[..., Model], trace_of: Callable[..., Trace]) -> None:
    hostile = "</script><script>alert(1)</script>"
    model = model_of()._replace(name=hostile)
    sensors = (model.main.inputs[0]._replace(name=hostile), model.main.inputs[1])
    model = model._replace(main=model.main._replace(inputs=sensors))
    trace = trace_of(60)
    columns = {f"{hostile}_degC": trace.columns["usb_degC"], **trace.columns}

    page = evaluation_page(model, [evaluate_trace(model, replace(trace, path=hostile, columns=columns))])

    assert "alert(1)" in page
    assert "<script>alert" not in page


def test_a_spread_is_told_in_its_own_unit(
    model_of: Callable[..., Model], guarded_of: Callable[..., Model], trace_of: Callable[..., Trace]
) -> None:
    constant, guarded = (
        evaluation_page(each, [evaluate_trace(each, trace_of(50))]) for each in (model_of(), guarded_of())
    )
    assert "90 %: -0.60 to +0.70 °C, 98 %" in constant
    assert "90 %: -1.50 to +1.80 sigma, 98 %: -2.40 to +2.50 sigma; sigma grows with the estimate" in guarded
