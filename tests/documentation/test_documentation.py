"""README and tutorial are executed: their files written, their commands and Python run, in order, in one folder."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
PAGES = {"README": README, "tutorial": ROOT / "trainer" / "docs" / "tutorial.md"}
MOST_BYTES = 8192


class Block(NamedTuple):
    """A fenced block: its language, its text, its line, and the file that it is written to."""

    language: str
    text: str
    line: int
    file: str | None


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    pattern = r"(?:<!-- file: (?P<file>\S+) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$"
    return [
        Block(each["language"], each["text"], text.count("\n", 0, each.start()) + 1, each["file"])
        for each in re.finditer(pattern, text, re.DOTALL | re.MULTILINE)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_every_command_and_snippet_runs(name: str, beside, tmp_path: Path) -> None:
    shutil.copy(beside("measured/thermal-shock-chamber/dat00002.csv"), tmp_path)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "NO_COLOR": "1"}
    ran = 0
    for block in blocks(PAGES[name]):
        if block.file is not None:
            (tmp_path / block.file).write_text(block.text)
        elif block.language in ("sh", "python"):
            command = ["bash", "-euo", "pipefail"] if block.language == "sh" else [sys.executable, "-"]
            done = subprocess.run(
                command, input=block.text, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600
            )
            assert done.returncode == 0, f"{PAGES[name].name}, line {block.line}: {done.stderr}"
            ran += 1
    assert ran >= 3
    assert (tmp_path / "replay.csv").stat().st_size > 100_000


def test_the_readme_fits_a_page_and_has_both_commands() -> None:
    assert README.stat().st_size <= MOST_BYTES
    assert "ambient-trainer demo" in README.read_text(encoding="utf-8")


def test_every_link_of_a_readme_leads_somewhere() -> None:
    pages = [README, *(ROOT / folder / "README.md" for folder in ("daemon", "deploy", "shared", "tests", "trainer"))]
    missing = [
        f"{page.relative_to(ROOT)}: {target}"
        for page in pages
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8"))
        if not (page.parent / target).exists()
    ]
    assert missing == []
