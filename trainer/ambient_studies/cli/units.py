"""``ambient-trainer units``: what a model of one phone is worth on others of the same make."""

import click

from ambient_trainer.cli import Output, jobs_option, output_options, sampling_option, staged_progress


@click.command("units")
@click.argument("model_path", metavar="MODEL.json")
@click.option("--count", type=click.IntRange(2, 10_000), default=50, help="How many phones.")
@click.option("--seed", type=click.IntRange(min=1), default=1, help="Of the phones and the weather; training has 0.")
@click.option("--scenarios", "scenario_list", metavar="A,B,...", default="4,1")
@sampling_option("Sampling.")
@output_options(page=True)
@jobs_option("Processes.")
def command(
    model_path: str, count: int, seed: int, scenario_list: str, period_s: float, output: Output, jobs: int
) -> None:
    """Run MODEL.json, made from one simulated phone, on others drawn within the tolerances of manufacture.

    Each goes through the scenarios bare and in a case; each is calibrated in ten minutes at rest in a known room, as
    ``correct`` does it, and scored with and without that correction. Every figure is simulated.
    """
    from ambient_model.codec import load_model
    from ambient_studies.unit_variation.report import report_of  # scipy: --help should not wait for it
    from ambient_studies.unit_variation.study import Plan, study

    output.check([model_path])
    model = load_model(model_path)
    plan = Plan(count, seed, tuple(dict.fromkeys(scenario_list.split(","))), period_s)
    with staged_progress() as progress:
        found = study(model, plan, jobs, progress)
    output.show(report_of(found))
