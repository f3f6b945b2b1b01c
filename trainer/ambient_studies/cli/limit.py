"""``ambient-trainer limit``: how much better than a model a linear filter could be, on the simulated phone."""

from __future__ import annotations

import click
from threadpoolctl import threadpool_limits

from ambient_model.codec import load_model
from ambient_studies.lower_bound.limit import Seeds, limits
from ambient_studies.lower_bound.summary import as_json, limit_table, sentences
from ambient_trainer.cli.lists import whole_numbers
from ambient_trainer.cli.number import sampling_option
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer, write_figures
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.report.table import for_terminal


@click.command("limit")
@click.argument("model_path", metavar="MODEL.json")
@click.option("--scenarios", "scenario_list", metavar="A,B,...", default="4", show_default=True, help="Or: all.")
@click.option("--seeds", "seed_list", metavar="N,N,...", default="3,4,5", show_default=True, help="Of the scored runs.")
@click.option(
    "--fitted",
    type=click.IntRange(1, 100),
    default=10,
    show_default=True,
    help="How many other runs of a scenario the filters are fitted to.",
)
@sampling_option("Sampling.")
@click.option("--json", "json_path", metavar="OUT", help="Write the figures to this file as JSON.")
def command(
    model_path: str, scenario_list: str, seed_list: str, fitted: int, period_s: float, json_path: str | None
) -> None:
    """Put beside MODEL.json the best linear causal filters that were fitted to the very scenario they are scored on.

    One has the model's order and sensors, one many low-passes of the same sensors, one those of every zone of the
    phone. Every figure is simulated.
    """
    check_outputs([json_path], [model_path])
    from ambient_trainer.simulator.scenario import scenario_names

    scenarios = scenario_names() if scenario_list == "all" else tuple(dict.fromkeys(scenario_list.split(",")))
    seeds = Seeds.after(whole_numbers("--seeds", seed_list), fitted)
    model = load_model(model_path)
    with staged_progress() as progress, threadpool_limits(1):
        found = limits(model, scenarios, seeds, period_s, progress)
    printer().print(for_terminal(limit_table(model, found)))
    for line in sentences(found):
        click.echo(line)
    if json_path is not None:
        write_figures(json_path, as_json(model, found, seeds))
