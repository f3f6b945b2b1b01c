"""``ambient-trainer reproduce``: the thesis's evaluation on a simulated phone, beside what the thesis published."""

from __future__ import annotations

from collections.abc import Sequence

import click
from rich.text import Text

from ambient_studies.thesis.errata import Erratum
from ambient_studies.thesis.published import published_results
from ambient_studies.thesis.reproduction import Reproduction, all_methods, as_json, errata_of, reproduce
from ambient_studies.thesis.tables import overview_table, scenario_tables
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer, write_figures, write_page
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.report.table import for_terminal


@click.command("reproduce")
@click.option("--json", "json_path", metavar="OUT", help="Write every figure to this file as JSON.")
@click.option("--report", "report_folder", metavar="DIR", help="Write a page with tables and plots into this folder.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Another one, other weather.")
def command(json_path: str | None, report_folder: str | None, seed: int) -> None:
    """Train the thesis's models and its related methods on a simulated phone, and score them in every scenario.

    Prints the thesis's tables 5.1 to 5.12 with the published figures beside the simulated ones, and what is not alike.
    """
    check_outputs([json_path], [], report_folder)
    with staged_progress() as progress:
        found = reproduce(seed, all_methods, published_results(), progress)
        errata = errata_of(found.runs, progress) if json_path or report_folder else []
        progress("drawing the report", 0, 1)
        page = _page(found, errata) if report_folder else ""
    _show(found)
    if json_path:
        write_figures(json_path, as_json(found, errata))
    if report_folder:
        write_page(report_folder, page)


def _page(found: Reproduction, errata: Sequence[Erratum]) -> str:
    # plotly takes half a second to import: only a report should wait for it
    from ambient_studies.thesis.page import reproduction_page

    return reproduction_page(found, errata)


def _show(found: Reproduction) -> None:
    console = printer()
    for each in scenario_tables(found.evaluated.rows):
        console.rule(Text(each.title, style="bold"), align="left")
        console.print(for_terminal(each.errors))
        console.print(for_terminal(each.intervals))
    console.rule(Text("Every method, every variant (simulated)", style="bold"), align="left")
    console.print(for_terminal(overview_table(found.evaluated.rows)))
    console.print(Text(found.verdict.headline, style="bold"))
    if found.verdict.shortfalls:
        console.print("Not as in the thesis:")
    for line in found.verdict.shortfalls:
        console.print(Text(f"- {line}"), soft_wrap=True)
