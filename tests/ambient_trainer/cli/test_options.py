"""Options that several commands share refuse what makes no sense before any work, and ``--help`` waits for nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest
from click.testing import CliRunner

from ambient_trainer.cli.main import COMMANDS, STUDIES, trainer
from ambient_trainer.cli.options import sensor_columns, sensor_names
from ambient_trainer.data.plugins import plugin_names


@pytest.mark.parametrize(
    ("call", "named"),
    [
        ("diagnose x.csv --circuit phone --period nan", ("--period", "nan")),
        ("fit x.csv --circuit phone -o x.json --period inf", ("--period", "inf")),
        ("simulate 5 -o x.csv --period 0.01", ("--period", "0.01")),
        ("mitigate x.json --limit nan", ("--limit", "nan")),
        ("evaluate x.json x.csv --from 20 --to 10", ("--from 20", "--to 10")),
        ("limit x.json --seeds 1,-2", ("--seeds", "1,-2")),
    ],
)
def test_a_number_that_makes_no_sense_is_named(call: str, named: tuple[str, ...]) -> None:
    done = CliRunner().invoke(trainer, call.split())
    assert done.exit_code == 2
    for part in named:
        assert part in done.output


def test_a_list_of_sensors_is_taken_with_and_without_the_unit() -> None:
    assert sensor_names(" usb, battery_degC,,") == ("usb", "battery")
    assert sensor_columns("usb,battery_degC") == ("usb_degC", "battery_degC")
    assert sensor_columns(None) == ()


def test_help_names_every_command_and_imports_no_numpy() -> None:
    code = "import sys; sys.argv = ['x', '--help']\ntry:\n from ambient_trainer.cli.main import main; main()\n"
    code += "finally:\n print(sorted({'numpy', 'plotly', 'pandas', 'rich'} & set(sys.modules)), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    listed = {line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ") and line.strip()}
    assert listed >= {*plugin_names(COMMANDS), *plugin_names(STUDIES)}
    assert done.stderr.strip() == "[]"
