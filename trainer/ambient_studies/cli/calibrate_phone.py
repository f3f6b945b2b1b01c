"""``ambient-trainer calibrate-phone``: fit the simulated phone to the thesis's figures and print what is left."""

from __future__ import annotations

from pathlib import Path

import click

from ambient_model.atomic import replacing
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer
from ambient_trainer.cli.progress import counted_progress
from ambient_trainer.report.table import for_terminal

BUDGET = 25


@click.command("calibrate-phone")
@click.option("-o", "--output", default="phone.yaml", show_default=True, type=click.Path(dir_okay=False), help="YAML.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of weather and noise.")
@click.option(
    "--budget",
    type=click.IntRange(min=0),
    default=BUDGET,
    show_default=True,
    help="Evaluations at most; 0 fits nothing, writes nothing, and prints what the shipped constants give.",
)
def command(output: str, seed: int, budget: int) -> None:
    """Fit the simulated phone's unknown constants to the published figures, from the engineer's guesses.

    Prints how far the raw sensors' means and standard deviations are from the thesis's, and how the ranks of the
    models' errors agree. The same call gives the same file.
    """
    from ambient_studies.thesis.calibration import calibrate
    from ambient_studies.thesis.outcome import outcome_table, outcomes, rank_table, ranked
    from ambient_trainer.simulator.device_file import device_path, load_constants, load_device, rounded, with_calibrated

    if budget:
        check_outputs([output], [])
    constants = load_constants()
    values = {name: each.value for name, each in constants.items()}
    console = printer()
    if budget:
        with counted_progress() as progress:
            progress("calibrating", 0, budget)
            found = calibrate(
                constants, budget, seed, lambda done, cost: progress(f"calibrating, cost {cost:.1f}", done, budget)
            )
        values = {name: rounded(value) for name, value in found.values.items()}
        with replacing(output) as stream:
            stream.write(with_calibrated(Path(device_path("phone")).read_text(encoding="utf-8"), values))
        click.echo(
            f"{len(values)} constants from {found.evaluations} evaluations, cost {found.cost_before:.1f} to "
            f"{found.cost:.1f}: {output}"
        )
    device = load_device().with_values(values)
    console.print(for_terminal(outcome_table(outcomes(device, seed))))
    with counted_progress() as progress:
        rows = ranked(device, seed, progress)
    console.print(for_terminal(rank_table(rows)))
