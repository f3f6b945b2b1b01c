"""``ambient-trainer import``: another logger's file becomes a trace, and the terminal shows what came in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ambient_trainer import cli
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.report import Finding, Report

if TYPE_CHECKING:
    from ambient_trainer.data.importers._table import Imported

IMPORTERS = "ambient_trainer.data.importers"
_FILE, _FORMAT = click.Path(exists=True, dir_okay=False), click.Choice(list(plugin_names(IMPORTERS)))


class _WithFormats(click.Command):
    """A command whose help lists the importers, which ``ambient-trainer --help`` should not wait for."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Formats"):
            formatter.write_dl([(name, f"{plugin(IMPORTERS, name).HELP}.") for name in plugin_names(IMPORTERS)])


@click.command("import", cls=_WithFormats)
@click.argument("src", type=_FILE)
@click.option("--format", "kind", type=_FORMAT, required=True, help="How SRC is written; see Formats.")
@click.option("--map", "map_path", type=_FILE, help="YAML: which columns to take, their names and units.")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False), help="The trace; .gz compresses it.")
def command(src: str, kind: str, map_path: str | None, output: str) -> None:
    """Turn the file SRC of another logger into a trace.

    \b
    A map, in short:
      time: {column: t, unit: s}       # or format: "%d.%m.%Y %H:%M:%S"
      columns:
        battery_degC: T_battery
        cpu_degC: {from: T_cpu, unit: mdegC}
        ambient_degC: {from: [T1, T2], combine: mean}
      constants: {ambient_degC: 22}    # not logged: noted as assumed
      delimiter: whitespace            # or one character; decimal: "," for 3,5
      header: false                    # columns are called 1, 2, 3, ...
      skip_rows: 15                    # above the names; skip_under_header: 1 below them
      drop_rows: {Status: [STOP]}      # rows to leave out; bad_rows: drop for unreadable ones
    """
    from ambient_trainer.data.trace import save_trace  # numpy and pandas: --help should not wait for them

    cli.Output().check([src, *([map_path] if map_path else [])], [output])
    importer = plugin(IMPORTERS, kind)
    if map_path is None and getattr(importer, "NEEDS_MAP", False):
        raise click.UsageError(f"--format {kind} needs --map MAP.yaml; see 'ambient-trainer import --help' for one.")
    imported = importer.import_file(src, map_path)
    save_trace(output, imported.trace)
    cli.Output().show(_report(imported))
    click.echo(f"wrote {output}")


def _report(imported: Imported) -> Report:
    import pandas as pd

    from ambient_trainer.report.words import column_table, duration

    trace = imported.trace
    extent = f"{len(trace.time_s)} rows"
    if len(trace.time_s) > 1:
        steps_s = pd.Series(trace.time_s).diff()
        extent += f", {duration(trace.time_s[-1], 3)}, median period {duration(steps_s.median(), 3)}"
        extent += f", longest step {duration(steps_s.max(), 3)}"
    total = imported.dropped_rows + len(trace.time_s)
    notes = [f"dropped {count} of {total} rows: {why}" for why, count in imported.dropped.items()]
    if "assumed" in trace.notes:
        notes.append(f"assumed {trace.notes['assumed']}")
    return Report(extent, [column_table(pd.DataFrame(trace.columns)), *map(Finding, notes)], [], {})
