"""``ambient-trainer units``: what a model of one phone is worth on others of the same make."""

from __future__ import annotations

import click

from ambient_model.codec import load_model
from ambient_studies.unit_variation.study import Plan, Study, study
from ambient_studies.unit_variation.summary import as_json, sentences, units_table
from ambient_trainer.cli.effort import jobs_option
from ambient_trainer.cli.number import sampling_option
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer, write_figures, write_page
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.report.table import for_terminal


@click.command("units")
@click.argument("model_path", metavar="MODEL.json")
@click.option("--count", type=click.IntRange(2, 10_000), default=50, show_default=True, help="How many phones.")
@click.option(
    "--seed",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Of the phones and the weather; training has 0.",
)
@click.option("--scenarios", "scenario_list", metavar="A,B,...", default="4,1", show_default=True)
@sampling_option("Sampling.")
@click.option("--json", "json_path", metavar="OUT", help="Write the figures to this file as JSON.")
@click.option("--report", "report_folder", metavar="DIR", help="Write a page with plots into this folder.")
@jobs_option("Processes.")
def command(
    model_path: str,
    count: int,
    seed: int,
    scenario_list: str,
    period_s: float,
    json_path: str | None,
    report_folder: str | None,
    jobs: int,
) -> None:
    """Run MODEL.json, made from one simulated phone, on others drawn within the tolerances of manufacture.

    Each goes through the scenarios bare and in a case; each is calibrated in ten minutes at rest in a known room, as
    ``correct`` does it, and scored with and without that correction. Every figure is simulated.
    """
    check_outputs([json_path], [model_path], report_folder)
    model = load_model(model_path)
    plan = Plan(count, seed, tuple(dict.fromkeys(scenario_list.split(","))), period_s)
    with staged_progress() as progress:
        found = study(model, plan, jobs, progress)
        page = _page(found) if report_folder else ""
    printer().print(for_terminal(units_table(found)))
    for line in sentences(found):
        click.echo(line)
    if json_path is not None:
        write_figures(json_path, as_json(found))
    if report_folder is not None:
        write_page(report_folder, page)


def _page(found: Study) -> str:
    # plotly takes half a second to import: only a report should wait for it
    from ambient_studies.unit_variation.page import units_page

    return units_page(found)
