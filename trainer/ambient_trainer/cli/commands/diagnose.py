"""``ambient-trainer diagnose``: what a circuit gets wrong about traces, its cause, and what adding that gains."""

from typing import Any

import click

import ambient_trainer as at
from ambient_trainer import cli


@click.command("diagnose")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@cli.circuit_option()
@click.option(
    "--baseline",
    "baselines",
    multiple=True,
    metavar="TRACE",
    help="A known-good trace of the same device: the question is then what changed since. May be given often.",
)
@cli.window_options
@click.option(
    "--later",
    "later_from_s",
    type=cli.Finite(),
    metavar="FROM_S",
    help="Keep the samples from this time_s on for a test of the circuit without and with what was found.",
)
@cli.period_option("at most 2000 samples, or as short as time constants ask for")
@cli.output_options("the diagnosis", page=True)
@click.option("--extended", "extended_path", metavar="FILE.yaml", help="Write the circuit with what was missing.")
@cli.jobs_option("Candidates at a time.")
def command(
    trace_paths: tuple[str, ...], circuit: str, output: cli.Output, extended_path: str | None, **question: Any
) -> None:
    """Show where TRACE and the simulated circuit differ, name the cause, and measure what adding it gains.

    The circuit is simulated forward: ambient and drives in, every sensor out. With --baseline it is fitted to
    known-good traces, and the question is what changed; without, the question is what the circuit lacks.
    """
    output.check([*trace_paths, *question["baselines"], circuit], [extended_path])
    with cli.staged_progress() as progress:
        result = at.diagnose(trace_paths, circuit, progress=progress, **question)
    if extended_path is not None and result.extended is not None:
        result.save_circuit(extended_path)
    output.show(result.summary)
    if extended_path is not None:
        none = "No cause is one that a circuit can hold: no circuit is written."
        click.echo(none if result.extended is None else f"Circuit: {extended_path}")
