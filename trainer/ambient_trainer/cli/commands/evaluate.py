"""``ambient-trainer evaluate``: how wrong a model is on traces, on the terminal, for a machine and as a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import click
from rich.panel import Panel
from rich.text import Text

from ambient_model.codec import load_model
from ambient_model.model import Model
from ambient_trainer.cli.options import output_options, window_options
from ambient_trainer.cli.output import Output
from ambient_trainer.cli.printing import printer, write_figures
from ambient_trainer.cli.progress import counted_progress
from ambient_trainer.evaluation.evaluate import Evaluation, evaluate_file, evaluate_file_run_in
from ambient_trainer.evaluation.summary import as_json, figures_table, verdict, warnings
from ambient_trainer.report.table import for_terminal


@click.command("evaluate")
@click.argument("model_path", metavar="MODEL.json")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@window_options
@click.option("--run-in", is_flag=True, help="Run the estimate from the trace's start on; score it from --from on.")
@output_options(page=True)
def command(
    model_path: str,
    trace_paths: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    run_in: bool,
    output: Output,
) -> None:
    """Run MODEL.json over each TRACE as the device would and compare the estimate with the trace's ambient_degC.

    The estimate starts from the first sensor sample, never from the reference, and is scored from there on: with
    --from, from a cold start at that time, or, with --run-in, as on a device that was already on.
    """
    if run_in and from_s is None:
        raise click.UsageError("--run-in goes with --from: without it the estimate runs from the start anyway")
    output.check([model_path, *trace_paths])
    model = load_model(model_path)
    evaluated = evaluate_file_run_in if run_in else evaluate_file
    evaluations = _evaluate(trace_paths, lambda path: evaluated(model, path, from_s, to_s))
    _show(evaluations)
    if output.json_path is not None:
        write_figures(output.json_path, as_json(model, evaluations))
    if output.report_folder is not None:
        click.echo(f"Report: {_write_report(output.report_folder, model, evaluations)}")


def _evaluate(trace_paths: Sequence[str], evaluated: Callable[[str], Evaluation]) -> list[Evaluation]:
    evaluations = []
    with counted_progress() as progress:
        for done, path in enumerate(trace_paths):
            progress(path, done, len(trace_paths))
            evaluations.append(evaluated(path))
    return evaluations


def _show(evaluations: Sequence[Evaluation]) -> None:
    console = printer()
    for warning in warnings(evaluations):
        console.print(Panel(Text(warning, style="bold"), border_style="red", expand=False))
    console.print(for_terminal(figures_table(evaluations)))
    console.print(Text(verdict(evaluations)), soft_wrap=True)


def _write_report(folder: str, model: Model, evaluations: Sequence[Evaluation]) -> str:
    # plotly takes half a second to import: only a report should wait for it
    from ambient_trainer.evaluation.page import evaluation_page
    from ambient_trainer.report.page import write_report

    return write_report(folder, evaluation_page(model, evaluations))
