"""``ambient-trainer calibrate-phone``: fit the simulated phone to the thesis's figures and print what is left."""

from pathlib import Path

import click

from ambient_model.atomic import replacing
from ambient_trainer.cli import Output, counted_progress, seed_option

BUDGET = 25


@click.command("calibrate-phone")
@click.option("-o", "--output", default="phone.yaml", type=click.Path(dir_okay=False), help="YAML.")
@seed_option("Of weather and noise.")
@click.option(
    "--budget",
    type=click.IntRange(min=0),
    default=BUDGET,
    help="Evaluations at most; 0 fits nothing, writes nothing, and prints what the shipped constants give.",
)
def command(output: str, seed: int, budget: int) -> None:
    """Fit the simulated phone's unknown constants to the published figures, from the engineer's guesses.

    Prints how far the raw sensors' means and standard deviations are from the thesis's, and how the ranks of the
    models' errors agree. The same call gives the same file.
    """
    from ambient_studies.thesis.calibration import calibrate
    from ambient_studies.thesis.outcome import outcomes, ranked, report_of
    from ambient_trainer.simulator import device_path, load_constants, load_device, rounded, with_calibrated

    constants = load_constants()
    values, fitted = {name: each.value for name, each in constants.items()}, ""
    if budget:
        Output().check([], [output])
        with counted_progress() as progress:
            progress("calibrating", 0, budget)
            result = calibrate(
                constants, budget, seed, lambda done, cost: progress(f"calibrating, cost {cost:.1f}", done, budget)
            )
        values = {name: rounded(value) for name, value in result.values.items()}
        with replacing(output) as stream:
            stream.write(with_calibrated(Path(device_path("phone")).read_text(encoding="utf-8"), values))
        fitted = (
            f"{len(values)} constants from {result.evaluations} evaluations, cost {result.cost_before:.1f} to "
            f"{result.cost:.1f}: {output}"
        )
    device = load_device().with_values(values)
    with counted_progress() as progress:
        rows = ranked(device, seed, progress)
    Output().show(report_of(outcomes(device, seed), rows, fitted))
