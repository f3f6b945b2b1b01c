"""What cannot be written is refused before the work, by every command that takes long."""

import io
import json
import os
from contextlib import redirect_stdout

import click
import pytest

from ambient_trainer.cli.output import Output
from ambient_trainer.report import Finding, Report


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a file, a folder with something in the page's place, and one into which nothing can be written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("kept")
    for name in ("taken/index.html", "page", "closed"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "leads_nowhere").symlink_to(tmp_path / "gone")
    writable = os.access  # whoever runs the tests may be allowed everything
    monkeypatch.setattr(os, "access", lambda path, mode: "closed" not in str(path) and writable(path, mode))
    return tmp_path


@pytest.mark.parametrize(
    ("report", "wanted", "inputs", "place", "reason"),
    [
        ("notes.txt/page", [], [], "notes.txt/page", "{here}/notes.txt is no folder"),
        ("leads_nowhere", [], [], "leads_nowhere", "no folder"),
        ("closed", [], [], "closed", "{here}/closed"),
        ("closed/a/b", [], [], "closed/a/b", "{here}/closed"),
        ("taken", [], [], "taken/index.html", "is a folder"),
        ("page", ["/dev/null"], [], "/dev/null", "device"),
        ("page", [""], [], "", "is a folder"),
        ("page", ["gone/out.json"], [], "gone/out.json", "no folder {here}/gone"),
        ("page", ["page/index.html"], [], "page/index.html", "twice"),
        ("page", ["notes.txt"], ["./notes.txt"], "notes.txt", "overwritten"),
        ("page", [], ["page/plotly.min.js"], "page/plotly.min.js", "overwritten"),
    ],
)
def test_what_cannot_be_written_or_would_be_overwritten_is_refused(here, report, wanted, inputs, place, reason):
    with pytest.raises(click.UsageError) as refused:
        Output(report_folder=report).check(inputs, wanted)
    assert refused.value.message.startswith(f"{place}: " if place else reason)
    assert reason.format(here=here) in refused.value.message
    assert "\n" not in refused.value.message


@pytest.mark.parametrize("report", ["new", "new/and/deeper", ".", "closed/../new"])
def test_a_report_may_be_written_over_or_made(here, report):
    Output("out.json", report).check(["notes.txt"])
    assert not (here / "new").exists()


def test_a_report_is_written_where_asked_and_shown_to_whoever_still_reads(here, capsys):
    Output("out.json", "new").show(Report("1.5 degC", [Finding("It [holds].")], [], {"rmse_degC": 1.5}))
    assert capsys.readouterr().out.splitlines()[:2] == ["1.5 degC", "It [holds]."]
    assert json.loads((here / "out.json").read_text()) == {"rmse_degC": 1.5}
    assert {each.name for each in (here / "new").iterdir()} == {"index.html", "plotly.min.js"}
    reading, writing = os.pipe()
    os.close(reading)
    closed = io.TextIOWrapper(os.fdopen(writing, "wb", 0), write_through=True)
    with closed, redirect_stdout(closed), pytest.raises((BrokenPipeError, SystemExit)):
        Output("again.json").show(Report("0 degC", [], [], {}))
    assert (here / "again.json").exists()
