"""No traceback reaches a user: status 0 is done, 1 the work failed, 2 the call was wrong, and a message says why."""

from __future__ import annotations

import importlib
import os
import sys

import click

from ambient_model import __version__
from ambient_model.faults import Refused

COMMANDS = {
    "calibrate": "calibrate",
    "calibrate-phone": "calibrate_phone",
    "collect": "collect",
    "compare": "compare",
    "correct": "correct",
    "demo": "demo",
    "diagnose": "diagnose",
    "discover": "discover",
    "evaluate": "evaluate",
    "fit": "fit",
    "identifiability": "identifiability",
    "import": "import_",
    "limit": "limit",
    "mitigate": "mitigate",
    "reproduce": "reproduce",
    "search": "search",
    "simulate": "simulate",
    "units": "units",
}


class _LazyCommands(click.Group):
    """Imports a command's module when the command is asked for: ``--help`` should not wait for plots."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"ambient_trainer.cli.{COMMANDS[cmd_name]}")
        command: click.Command = module.command
        return command


@click.command(cls=_LazyCommands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="ambient-trainer")
def trainer() -> None:
    """Fit thermal circuits to logged temperatures, see what they get right and wrong, export them for a device."""


def main() -> None:
    """Run the command line and exit with its status."""
    # four threads on 5 x 5 matrices are ten times slower than one
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        status = trainer(standalone_mode=False, prog_name="ambient-trainer")
        sys.exit(status if isinstance(status, int) else 0)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except Refused as refused:
        click.echo(f"ambient-trainer: {refused}", err=True)
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        click.echo("ambient-trainer: stopped", err=True)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)
    except OSError as error:
        click.echo(f"ambient-trainer: {error.filename or 'output'}: {error.strerror or error}", err=True)
        sys.exit(1)
