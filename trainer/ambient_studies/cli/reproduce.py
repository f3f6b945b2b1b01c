"""``ambient-trainer reproduce``: the thesis's evaluation on a simulated phone, beside what the thesis published."""

import click

from ambient_trainer.cli import Output, output_options, seed_option, staged_progress


@click.command("reproduce")
@output_options("every figure", page=True)
@seed_option("Another one, other weather.")
def command(output: Output, seed: int) -> None:
    """Train the thesis's models and its related methods on a simulated phone, and score them in every scenario.

    Prints the thesis's tables 5.1 to 5.12 with the published figures beside the simulated ones, and what differs.
    """
    from ambient_studies.thesis.errata import computed_errata
    from ambient_studies.thesis.outcome import outcomes  # scipy: --help should not wait for it
    from ambient_studies.thesis.published import published_results
    from ambient_studies.thesis.report import report_of
    from ambient_studies.thesis.reproduction import all_methods, reproduce
    from ambient_trainer.simulator import load_device

    output.check([])
    with staged_progress() as progress:
        found = reproduce(seed, all_methods, published_results(), progress)
        errata = []
        if output.json_path or output.report_folder:
            progress("computing the errata", 0, 1)
            errata = computed_errata(found.runs.training, found.runs.evaluated["3"])
        calibration = outcomes(load_device(), seed) if output.report_folder else []
    output.show(report_of(found, errata, calibration))
