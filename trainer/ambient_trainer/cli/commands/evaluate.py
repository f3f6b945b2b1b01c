"""``ambient-trainer evaluate``: how wrong a model is on traces, on the terminal, for a machine and as a page."""

from typing import Any

import click

import ambient_trainer as at
from ambient_trainer import cli


@click.command("evaluate")
@click.argument("model_path", metavar="MODEL.json")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@cli.window_options
@click.option("--run-in", is_flag=True, help="Run the estimate from the trace's start on; score it from --from on.")
@click.option("--stress", is_flag=True, help="Also score the first trace with missing, coarse and wrong readings.")
@cli.output_options(page=True)
def command(model_path: str, trace_paths: tuple[str, ...], output: cli.Output, **question: Any) -> None:
    """Run MODEL.json over each TRACE as the device would and compare the estimate with the trace's ambient_degC.

    The estimate starts from the first sensor sample, never from the reference, and is scored from there on: with
    --from, from a cold start at that time, or, with --run-in, as on a device that was already on.
    """
    if question["run_in"] and question["from_s"] is None:
        raise click.UsageError("--run-in goes with --from: without it the estimate runs from the start anyway")
    output.check([model_path, *trace_paths])
    with cli.counted_progress() as progress:
        result = at.evaluate(model_path, trace_paths, progress=progress, **question)
    output.show(result.summary)
