"""``ambient-trainer evaluate`` from outside: its JSON, its words, its exit status."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

from click.testing import CliRunner

from ambient_trainer.cli.commands.evaluate import command
from ambient_trainer.data.trace import Trace

Files = Callable[..., tuple[str, str]]
TraceOf = Callable[..., Trace]

BASELINE = {"kind": "static linear", "gains": {"usb": 1.25, "battery": -0.3}, "offset": 0.5}


def test_the_terminal_shows_the_figures_of_the_json(files: Files, trace_of: TraceOf, tmp_path: Path) -> None:
    whole = trace_of(1200)
    whole.columns["usb_degC"][:7] = 95.0  # above the input's range
    model, trace = files(whole, {"baseline": BASELINE})
    out = tmp_path / "out.json"
    result = CliRunner().invoke(command, [model, trace, "--json", str(out)], catch_exceptions=False)
    (only,) = json.loads(out.read_text())["traces"]
    assert (only["samples"], only["unscored"], only["overlaps_training"]) == (1193, 7, False)
    for figures in (only, only["baseline"]):
        assert list(figures["interval_degC"]) == ["50", "90", "98"]
        assert all(low < figures["mbe_degC"] < high for low, high in figures["interval_degC"].values())
    lines = [line.split() for line in result.output.splitlines() if "trace.csv" in line]
    rmse = [f"{figures['rmse_degC']:.2f}" for figures in (only, only["baseline"])]
    assert [rmse[k] in line and "1,193" in line for k, line in enumerate(lines)] == [True, True]
    title, *findings = result.output.splitlines()
    assert rmse[0] in title
    assert "1,193" in title
    assert any(rmse[1] in line for line in findings)
    assert f"{100 * only['coverage']['90']:.1f} %" in result.output
    assert "7 more samples have no estimate" in result.output


def test_the_title_counts_every_sample_once(files: Files, trace_of: TraceOf, tmp_path: Path) -> None:
    model, trace = files(trace_of(300))
    other = str(tmp_path / "other.csv")
    os.link(trace, other)
    result = CliRunner().invoke(command, [model, trace, other], catch_exceptions=False)
    title = result.output.splitlines()[0]
    assert "600 samples" in title
    assert "2 traces" in title


def test_figures_on_training_data_are_called_so(files: Files, trace_of: TraceOf, tmp_path: Path) -> None:
    _, trace = files(trace_of(120))
    digest = hashlib.sha256(Path(trace).read_bytes()).hexdigest()
    model, trace = files(trace_of(120), {"training": [{"trace": "t", "sha256": digest, "from_s": None, "to_s": 50}]})
    out, report = tmp_path / "out.json", tmp_path / "report"
    result = CliRunner().invoke(
        command, [model, trace, "--json", str(out), "--report", str(report)], catch_exceptions=False
    )
    assert json.loads(out.read_text())["traces"][0]["overlaps_training"] is True
    assert "Not held out: the model was trained on samples of trace.csv" in result.output
    assert "trace.csv (training data)" in result.output
    assert "Not held out: the model was trained on samples of trace.csv" in (report / "index.html").read_text()
