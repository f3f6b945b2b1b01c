"""What cannot be written is refused before the work, by every command that takes long."""

import json
import os

import click
import pytest

from ambient_trainer.cli.output import Output
from ambient_trainer.report import Finding, Report


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a file, a folder with something in the page's place, and one into which nothing can be written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("kept")
    (tmp_path / "taken" / "index.html").mkdir(parents=True)
    (tmp_path / "page").mkdir()
    (tmp_path / "closed").mkdir()
    (tmp_path / "leads_nowhere").symlink_to(tmp_path / "gone")
    writable = os.access  # whoever runs the tests may be allowed everything
    monkeypatch.setattr(os, "access", lambda path, mode: "closed" not in str(path) and writable(path, mode))
    return tmp_path


@pytest.mark.parametrize(
    ("report", "place", "reason"),
    [
        ("notes.txt", "notes.txt", "no folder"),
        ("notes.txt/page", "notes.txt/page", "{here}/notes.txt is no folder"),
        ("leads_nowhere", "leads_nowhere", "no folder"),
        ("closed", "closed", "{here}/closed"),
        ("closed/a/b", "closed/a/b", "{here}/closed"),
        ("taken", "taken/index.html", "is a folder"),
    ],
)
def test_a_report_that_cannot_be_written_is_refused(here, report, place, reason):
    with pytest.raises(click.UsageError) as refused:
        Output(report_folder=report).check([])
    assert refused.value.message.startswith(f"{place}: ")
    assert reason.format(here=here) in refused.value.message
    assert "\n" not in refused.value.message


@pytest.mark.parametrize("report", ["new", "new/and/deeper", ".", "closed/../new"])
def test_a_report_may_be_written_over_or_made(here, report):
    Output("out.json", report).check(["notes.txt"])
    assert not (here / "new").exists()


@pytest.mark.parametrize(
    ("wanted", "inputs", "place", "reason"),
    [
        (["/dev/null"], [], "/dev/null", "device"),
        ([""], [], "", "is a folder"),
        (["gone/out.json"], [], "gone/out.json", "no folder {here}/gone"),
        (["page/index.html"], [], "page/index.html", "twice"),
        (["notes.txt"], ["./notes.txt"], "notes.txt", "overwritten"),
        ([], ["page/plotly.min.js"], "page/plotly.min.js", "overwritten"),
    ],
)
def test_files_beside_a_report(here, wanted, inputs, place, reason):
    with pytest.raises(click.UsageError) as refused:
        Output(report_folder="page").check(inputs, wanted)
    assert refused.value.message.startswith(place)
    assert reason.format(here=here) in refused.value.message
    assert "\n" not in refused.value.message


def test_a_report_is_shown_and_written_where_asked(here, capsys):
    report = Report("1.5 degC", [Finding("It [holds].")], [], {"rmse_degC": 1.5})
    Output("out.json", "new").show(report)
    assert capsys.readouterr().out.splitlines()[:2] == ["1.5 degC", "It [holds]."]
    assert json.loads((here / "out.json").read_text()) == {"rmse_degC": 1.5}
    assert {each.name for each in (here / "new").iterdir()} == {"index.html", "plotly.min.js"}
