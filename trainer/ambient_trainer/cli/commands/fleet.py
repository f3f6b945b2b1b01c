"""``ambient-trainer fleet``: an estimator for each of many units, from their logs and what they have in common."""

from typing import Any

import click

import ambient_trainer as at
from ambient_trainer import cli

BROKEN = 1


@click.command("fleet")
@click.argument("logs", metavar="LOGS")
@click.option("--by", default="unit", metavar="COLUMN", help="The column that holds the unit.")
@cli.circuit_option("A shipped circuit or observer, a .yaml file, or free-1 to free-4.")
@click.option("-o", "--output", "folder", required=True, metavar="DIR", help="Where table and models go.")
@click.option("--within", type=cli.names, metavar="A,B,...", help="Columns of groups of units, one level more.")
@cli.sensors_option("every _degC column of most units")
@click.option(
    "--engine",
    default="local",
    metavar="local|serial|tcp://HOST:PORT",
    help="A Dask cluster on this machine, none, or any scheduler.",
)
@cli.jobs_option("Processes of the local cluster.")
@click.option(
    "--diagnose",
    metavar="NAME|FILE",
    help="Name what is odd about the units that fit least, with this circuit, beside typical ones.",
)
@click.option("--resume", is_flag=True, help="Go on where this command was interrupted.")
@click.option("--strict", is_flag=True, help="End with status 1 where a unit failed.")
@cli.starts_option
@cli.seed_option("Of the starting points.")
@cli.output_options("what the terminal shows", page=True)
def command(
    logs: str, circuit: str, folder: str, strict: bool, starts: int, seed: int, output: cli.Output, **how: Any
) -> int:
    """Fit an estimator to each unit in LOGS, partially pooled, and export one file a unit.

    LOGS is a folder of traces, CSV or Parquet, one a unit; or a Parquet dataset with a unit column, partitioned or not.
    DIR gets fleet.parquet, a row a unit, failures too; models/UNIT.json; and population.json, for a unit never seen.

    What units share is estimated from all of them, the rest from a unit's own log. A unit that cannot be read is a
    row with the reason. Ctrl-C keeps what is done for --resume.
    """
    output.check([logs, circuit], folder=folder)
    with cli.counted_progress() as progress:
        how |= {
            "effort": at.Effort(starts, seed),
            "progress": progress,
            "announce": lambda address: click.echo(f"Dask's dashboard: {address}"),
        }
        result = at.fit_fleet(logs, circuit, folder, **how)
    output.show(result.summary)
    click.echo(f"Table: {folder}/fleet.parquet, models: {folder}/models, for an unseen unit: {folder}/population.json")
    return BROKEN if strict and len(result.failed) else 0
