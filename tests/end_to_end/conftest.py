"""The commands as a user runs them, in this process or as their own."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import ambient_trainer.cli.main
import ambientd.__main__

ROOT = Path(__file__).resolve().parents[2]
MEASURED = ROOT.parent / "shared" / "measured"


@pytest.fixture
def call(capsys, monkeypatch):
    """Run a command line in this process: (status, what it printed, what it said on standard error)."""

    def run(program, *arguments):
        main = {"ambient-trainer": ambient_trainer.cli.main.main, "ambientd": ambientd.__main__.main}[program]
        monkeypatch.setattr(sys, "argv", [program, *map(str, arguments)])
        status = 0
        try:
            status = main() or 0
        except SystemExit as left:
            status = left.code or 0
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


@pytest.fixture(scope="session")
def process():
    """Run a command line as a process of its own; fails the test where it does."""

    def run(module, *arguments):
        done = subprocess.run([sys.executable, "-m", module, *map(str, arguments)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def chamber_log():
    """The multiplexer's export of the thermal shock chamber."""
    log = MEASURED / "thermal-shock-chamber" / "dat00002.csv"
    if not log.is_file():
        pytest.skip("the measured chamber log is not beside this checkout")
    return log


def comparison(text):
    """The RMSEs of a table that ``compare`` or ``demo`` printed, by circuit and column."""
    found = {}
    for line in text.splitlines():
        cells = line.split()
        if len(cells) == 9 and re.fullmatch(r"\d+", cells[1]):
            found[cells[0]] = dict(zip(("training", "held out", "static", "cold start"), map(float, cells[3:7])))
    return found


@pytest.fixture(scope="session")
def as_in_readme():
    """Hold the figures in the README's first code block behind some words against what a command printed."""

    def check(words, printed):
        readme = (ROOT / "README.md").read_text(encoding="utf-8")
        ours, theirs = comparison(readme[readme.index(words) :].split("```")[1]), comparison(printed)
        assert ours, "the README shows no table there"
        for circuit, figures in ours.items():
            for column, figure in figures.items():
                # to the last digit shown, or 3 %: processors round differently, and a search ends where it may
                assert abs(figure - theirs[circuit][column]) <= max(0.011, 0.03 * figure), (circuit, column)

    return check
