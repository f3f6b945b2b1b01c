"""A report folder is written whole; what cannot be written is said."""

import os
from pathlib import Path

import pytest

from ambient_model.faults import Refused
from ambient_trainer.report.page import write_report


def test_the_page_and_its_script_replace_the_old(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    write_report(str(folder), "old")

    assert write_report(str(folder), "new") == str(folder / "index.html")
    assert (folder / "index.html").read_text() == "new"
    assert (folder / "plotly.min.js").stat().st_size > 1_000_000
    assert len(os.listdir(folder)) == 2


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")

    with pytest.raises(Refused) as refused:
        write_report(str(tmp_path / "taken" / "report"), "page")

    assert str(refused.value) == (
        f"{tmp_path}/taken/report: cannot be made a folder (Not a directory); name another folder for the report"
    )
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_to_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)

    with pytest.raises(Refused, match="choose a folder that you may write to"):
        write_report(str(tmp_path), "page")
