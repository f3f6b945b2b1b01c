"""``ambient-trainer evaluate``: how wrong a model is on traces, on the terminal, for a machine and as a page."""

from __future__ import annotations

import click

from ambient_trainer.cli.options import output_options, window_options
from ambient_trainer.cli.output import Output
from ambient_trainer.cli.progress import counted_progress


@click.command("evaluate")
@click.argument("model_path", metavar="MODEL.json")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@window_options
@click.option("--run-in", is_flag=True, help="Run the estimate from the trace's start on; score it from --from on.")
@click.option("--stress", is_flag=True, help="Also score the first trace with missing, coarse and wrong readings.")
@output_options(page=True)
def command(
    model_path: str,
    trace_paths: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    run_in: bool,
    stress: bool,
    output: Output,
) -> None:
    """Run MODEL.json over each TRACE as the device would and compare the estimate with the trace's ambient_degC.

    The estimate starts from the first sensor sample, never from the reference, and is scored from there on: with
    --from, from a cold start at that time, or, with --run-in, as on a device that was already on.
    """
    from ambient_trainer.api.evaluating import evaluate  # scipy: --help should not wait for it

    if run_in and from_s is None:
        raise click.UsageError("--run-in goes with --from: without it the estimate runs from the start anyway")
    output.check([model_path, *trace_paths])
    with counted_progress() as progress:
        result = evaluate(
            model_path, trace_paths, from_s=from_s, to_s=to_s, run_in=run_in, stress=stress, progress=progress
        )
    output.show(result.summary)
