"""Options that several commands share refuse what makes no sense before any work, and ``--help`` waits for nothing."""

import importlib
import re
import subprocess
import sys

import pytest
from click.testing import CliRunner

from ambient_trainer.api.data import sensor_columns
from ambient_trainer.cli.main import COMMANDS, STUDIES, trainer
from ambient_trainer.cli.options import names
from ambient_trainer.data.plugins import plugin_names
from ambient_trainer.estimators.registry import LIBRARY, estimator, estimator_names


def test_a_list_of_sensors_is_taken_with_and_without_the_unit():
    assert names(" usb, battery_degC,,") == ("usb", "battery_degC")
    assert sensor_columns(names("usb,battery_degC")) == ("usb_degC", "battery_degC")
    assert sensor_columns(names("")) == ()


HELP = """
import sys
from ambient_trainer.cli.main import main
for words in {calls}:
    sys.argv = ["ambient-trainer", *words, "--help"]
    try:
        main()
    except SystemExit as left:
        assert left.code == 0, words
print(sorted({{"numpy", "scipy", "plotly", "pandas", "sklearn"}} & set(sys.modules)), file=sys.stderr)
"""


def helped(calls: list[list[str]]) -> str:
    """The help of each call, after which nothing heavy may have been imported."""
    run = [sys.executable, "-c", HELP.format(calls=calls)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "[]\n")
    return done.stdout


def test_help_names_every_command_and_waits_for_nothing():
    lines = helped([[]]).splitlines()
    assert {line.split()[0] for line in lines if line.startswith("  ") and line.strip()} >= {
        *plugin_names(COMMANDS), *plugin_names(STUDIES)
    }  # fmt: skip
    helped([[name] for name in plugin_names(COMMANDS) if name != "import"])  # which asks each format for its words


PLUG_IN = """
import click
from ambient_trainer.estimators.library.free import FreeFilterEstimator

NAMES = ("mine",)

def find(name):
    return FreeFilterEstimator(1) if name == "mine" else None

@click.command("hello")
def command():
    \"\"\"Say hello.\"\"\"
    click.echo("hello")
"""


@pytest.fixture
def no_plugins_remembered():
    plugin_names.cache_clear()
    yield
    plugin_names.cache_clear()


@pytest.mark.usefixtures("no_plugins_remembered")
def test_another_package_adds_a_command_and_an_estimator(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(PLUG_IN)
    described = tmp_path / "mine-1.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (described / "entry_points.txt").write_text(f"[{COMMANDS}]\nhello = mine\n[{LIBRARY}]\nmine = mine\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert re.search(r"hello +Say hello", CliRunner().invoke(trainer, ["--help"]).output)
    assert CliRunner().invoke(trainer, ["hello"]).output == "hello\n"
    assert "mine" in estimator_names()
    assert estimator("mine").name == "free-1"


@pytest.mark.usefixtures("no_plugins_remembered")
def test_a_new_command_is_one_file(tmp_path, monkeypatch):
    (tmp_path / "greet.py").write_text(PLUG_IN)
    package = importlib.import_module(COMMANDS)
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    assert CliRunner().invoke(trainer, ["greet"]).output == "hello\n"
