"""Options that several commands share refuse what makes no sense before any work, and ``--help`` waits for nothing."""

import importlib
import re
import sys
from unittest.mock import Mock

import pytest
from click.testing import CliRunner

from ambient_trainer.api.data import sensor_columns
from ambient_trainer.cli.main import COMMANDS, STUDIES, trainer
from ambient_trainer.cli.options import names
from ambient_trainer.data.plugins import plugin_names
from ambient_trainer.data.trace import load_trace
from ambient_trainer.estimators.registry import LIBRARY, estimator, estimator_names
from processes import ran


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
    done = ran(sys.executable, "-c", HELP.format(calls=calls))
    assert done.stderr == "[]\n"
    return done.stdout


def test_help_names_every_command_and_waits_for_nothing():
    lines = helped([[]]).splitlines()
    assert {line.split()[0] for line in lines if line.startswith("  ") and line.strip()} >= {
        *plugin_names(COMMANDS), *plugin_names(STUDIES)
    }  # fmt: skip
    helped([[name] for name in plugin_names(COMMANDS) if name != "import"])  # which asks each format for its words


PLUG_IN = """
import click
import numpy as np
from ambient_trainer.data.importers._table import Imported
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.library.free import FreeFilterEstimator

NAMES = ("mine",)

def find(name):
    return FreeFilterEstimator(1) if name == "mine" else None

@click.command("hello")
def command():
    \"\"\"Say hello.\"\"\"
    click.echo("hello")

HELP = "a thermometer that sends its temperature as a frequency, a line a second"

def import_file(path, map_path=None):
    hertz = np.loadtxt(path)
    return Imported(Trace(path, np.arange(len(hertz), dtype=float), {"usb_degC": hertz / 100}), {})
"""


@pytest.mark.usefixtures("plugged")
def test_another_package_adds_a_command_an_estimator_and_an_importer(tmp_path, monkeypatch):
    plugin_names.cache_clear()
    (tmp_path / "mine.py").write_text(PLUG_IN)
    described = tmp_path / "mine-1.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    groups = {COMMANDS: "hello", LIBRARY: "mine", "ambient_trainer.data.importers": "hertz"}
    entries = "".join(f"[{group}]\n{name} = mine\n" for group, name in groups.items())
    (described / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(tmp_path)
    assert re.search(r"hello +Say hello", CliRunner().invoke(trainer, ["--help"]).output)
    assert CliRunner().invoke(trainer, ["hello"]).output == "hello\n"
    assert "mine" in estimator_names()
    assert estimator("mine").name == "free-1"
    log, out = tmp_path / "log.txt", tmp_path / "out.csv"
    log.write_text("2000\n2150\n")
    monkeypatch.delitem(sys.modules, f"{COMMANDS}.import_", raising=False)  # it knows the formats of its first import
    done = CliRunner().invoke(trainer, ["import", str(log), "--format", "hertz", "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert load_trace(str(out)).columns["usb_degC"].tolist() == [20.0, 21.5]


def test_a_new_command_is_one_file(plugged):
    plugged(importlib.import_module(COMMANDS), "greet", PLUG_IN)
    assert CliRunner().invoke(trainer, ["greet"]).output == "hello\n"


def test_compiled_code_that_is_interrupted_is_stopped(monkeypatch, capsys):
    """It returns with an exception set, which Python makes a SystemError of."""
    cut = SystemError("returned a result with an exception set")
    cut.__cause__ = KeyboardInterrupt()
    module = importlib.import_module("ambient_trainer.cli.main")
    monkeypatch.setattr(module, "trainer", Mock(side_effect=cut))
    with pytest.raises(SystemExit, match="1"):
        module.main()
    assert capsys.readouterr().err == "ambient-trainer: stopped\n"
