"""``ambient-trainer limit``: how much better than a model a linear filter could be, on the simulated phone."""

import click

from ambient_trainer.cli import Output, output_options, sampling_option, staged_progress, whole_numbers


@click.command("limit")
@click.argument("model_path", metavar="MODEL.json")
@click.option("--scenarios", "scenario_list", metavar="A,B,...", default="4", help="Or: all.")
@click.option("--seeds", type=whole_numbers, metavar="N,N,...", default="3,4,5", help="Of the scored runs.")
@click.option(
    "--fitted",
    type=click.IntRange(1, 100),
    default=10,
    help="How many other runs of a scenario the filters are fitted to.",
)
@sampling_option("Sampling.")
@output_options()
def command(
    model_path: str, scenario_list: str, seeds: tuple[int, ...], fitted: int, period_s: float, output: Output
) -> None:
    """Put beside MODEL.json the best linear causal filters that were fitted to the very scenario they are scored on.

    One has the model's order and sensors, one many low-passes of the same sensors, one those of every zone of the
    phone. Every figure is simulated.
    """
    from threadpoolctl import threadpool_limits

    from ambient_model.codec import load_model
    from ambient_studies.lower_bound.report import report_of  # scipy: --help should not wait for it
    from ambient_studies.lower_bound.study import Seeds, lower_bounds
    from ambient_trainer.simulator import scenario_names

    output.check([model_path])
    scenarios = scenario_names() if scenario_list == "all" else tuple(dict.fromkeys(scenario_list.split(",")))
    first = max(seeds) + 1
    chosen = Seeds(tuple(range(first, first + fitted)), seeds)
    model = load_model(model_path)
    with staged_progress() as progress, threadpool_limits(1):
        found = lower_bounds(model, scenarios, chosen, period_s, progress)
    output.show(report_of(model, found, chosen))
