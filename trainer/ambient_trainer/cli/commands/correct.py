"""``ambient-trainer correct``: a model file for one unit, from ten minutes at a known ambient."""

import click

from ambient_model.codec import load_model, save_model
from ambient_trainer import cli


@click.command("correct")
@click.argument("model_path", metavar="MODEL.json")
@click.argument("trace_path", metavar="TRACE")
@click.option("-o", "--output", "corrected_path", required=True, metavar="MODEL2.json", help="The corrected model.")
@cli.window_options
@cli.output_options("the corrections")
def command(
    model_path: str, trace_path: str, corrected_path: str, from_s: float | None, to_s: float | None, output: cli.Output
) -> None:
    """Correct MODEL.json for the one device that logged TRACE while the ambient was known, and write it anew.

    The mean error of the estimate there is added to its offset, and so for its secondary estimator and each fallback.
    The estimate runs from TRACE's first sample on: log half an hour at rest before the minutes that count, and leave
    ambient_degC empty there or name them with --from.
    """
    from ambient_trainer.data.trace import load_trace  # numpy and scipy: --help should not wait for them
    from ambient_trainer.estimators.model_file import training_of
    from ambient_trainer.evaluation.correction import corrected, correction, report_of

    output.check([model_path, trace_path], [corrected_path])
    model, trace = load_model(model_path), load_trace(trace_path)
    result = correction(model, trace, from_s, to_s)
    save_model(corrected_path, corrected(model, result, training_of(trace, from_s, to_s)))
    output.show(report_of(result))
    click.echo(f"Model: {corrected_path}")
