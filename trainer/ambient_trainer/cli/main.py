"""Entry point: status 0 is done, 1 the work failed, 2 the call was wrong; errors are messages, not tracebacks."""

import importlib
import importlib.util
import os
import sys

import click

from ambient_model import __version__
from ambient_model.faults import Refused
from ambient_trainer.data.plugins import plugin_names

COMMANDS = "ambient_trainer.cli.commands"
STUDIES = "ambient_studies.cli"


class _LazyCommands(click.Group):
    """Finds commands by their place; their modules import what is heavy only when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*plugin_names(COMMANDS), *_studies()]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        module = {**_studies(), **plugin_names(COMMANDS)}.get(cmd_name)
        return importlib.import_module(module).command if module else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands, and under a heading of their own those of the studies."""
        for heading, modules in (("Commands", plugin_names(COMMANDS)), ("Studies of the simulated phone", _studies())):
            if modules:
                limit = formatter.width - 6 - max(map(len, modules))
                commands = {name: importlib.import_module(module).command for name, module in modules.items()}
                with formatter.section(heading):
                    formatter.write_dl([(name, each.get_short_help_str(limit)) for name, each in commands.items()])


def _studies() -> dict[str, str]:
    """The commands of the studies, by name; none where they are not installed."""
    return plugin_names(STUDIES) if importlib.util.find_spec(STUDIES.partition(".")[0]) else {}


@click.command(cls=_LazyCommands, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
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
    except (click.Abort, KeyboardInterrupt, SystemError) as error:
        # of compiled code that was interrupted the cause says so
        if isinstance(error, SystemError) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        click.echo("ambient-trainer: stopped", err=True)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)
    except OSError as error:
        click.echo(f"ambient-trainer: {error.filename or 'output'}: {error.strerror or error}", err=True)
        sys.exit(1)
