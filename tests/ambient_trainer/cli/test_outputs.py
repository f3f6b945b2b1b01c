"""What cannot be written is refused before the work, by every command that takes long."""

from __future__ import annotations

import os
import sys

import click
import pytest

from ambient_trainer.cli import outputs
from ambient_trainer.cli.main import main
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.report import page


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a file, a folder with something in the page's place, and one into which nothing can be written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("kept")
    (tmp_path / "taken" / "index.html").mkdir(parents=True)
    (tmp_path / "closed").mkdir()
    (tmp_path / "leads_nowhere").symlink_to(tmp_path / "gone")
    writable = os.access  # whoever runs the tests may be allowed everything
    monkeypatch.setattr(os, "access", lambda path, mode: "closed" not in str(path) and writable(path, mode))
    return tmp_path


@pytest.mark.parametrize(
    ("report", "told"),
    [
        ("notes.txt", "notes.txt: is no folder; name another folder for the report"),
        ("notes.txt/page", "notes.txt/page: cannot be made: {here}/notes.txt is no folder; name another folder for "),
        ("leads_nowhere", "leads_nowhere: is no folder; name another folder for the report"),
        ("closed", "closed: nothing can be written into {here}/closed; choose a folder that you may write to"),
        ("closed/a/b", "closed/a/b: nothing can be written into {here}/closed; choose a folder that you may write to"),
        ("taken", "taken/index.html: is a folder; name a file in it"),
    ],
)
def test_a_report_that_cannot_be_written_is_refused(here, report, told):
    with pytest.raises(click.UsageError) as refused:
        check_outputs([], [], report)
    assert refused.value.message.startswith(told.format(here=here))
    assert "\n" not in refused.value.message


@pytest.mark.parametrize("report", ["new", "new/and/deeper", ".", "closed/../new"])
def test_a_report_may_be_written_over_or_made(here, report):
    check_outputs(["out.json"], ["notes.txt"], report)
    assert not (here / "new").exists()


@pytest.mark.parametrize(
    ("wanted", "inputs", "told"),
    [
        (["/dev/null"], [], "/dev/null: is a device; name a file"),
        ([""], [], "is a folder; name a file in it"),
        (["gone/out.json"], [], "gone/out.json: there is no folder {here}/gone; make it first, or name another"),
        (["page/index.html"], [], "page/index.html: stands twice among the outputs; give each a name of its own"),
        ([], ["page/plotly.min.js"], "page/plotly.min.js: would be overwritten by what is made from it; name another "),
    ],
)
def test_files_beside_a_report(here, wanted, inputs, told):
    (here / "page").mkdir()
    with pytest.raises(click.UsageError) as refused:
        check_outputs(wanted, inputs, "page")
    assert refused.value.message.startswith(told.format(here=here))
    assert "\n" not in refused.value.message


def test_a_report_is_the_files_that_are_looked_at(tmp_path):
    page.write_report(str(tmp_path), "a page")
    assert {each.name for each in tmp_path.iterdir()} == set(outputs._OF_A_REPORT)


@pytest.mark.parametrize(
    "arguments",
    [
        "diagnose nothere.csv --circuit phone",
        "discover --circuit nosuch",
        "evaluate nothere.json nothere.csv",
        "mitigate nothere.json",
        "reproduce",
    ],
)
def test_before_anything_is_read_or_done(here, monkeypatch, capsys, arguments):
    monkeypatch.setattr("ambient_studies.cli.reproduce.reproduce", lambda *_: pytest.fail("it has begun"))
    monkeypatch.setattr(sys, "argv", ["ambient-trainer", *arguments.split(), "--report", "notes.txt"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert "Error: notes.txt: is no folder; name another folder for the report" in capsys.readouterr().err
    assert (here / "notes.txt").read_text() == "kept"
