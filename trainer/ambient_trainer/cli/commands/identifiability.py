"""``ambient-trainer identifiability``: which of a circuit's parameters a trace determines."""

import click

import ambient_trainer as at
from ambient_trainer import cli


def _fixed(text: str) -> tuple[str, float | None]:
    return cli.assigned("NAME or NAME=VALUE, such as C_flash=12", float)(text) if "=" in text else (text, None)


@click.command("identifiability")
@click.argument("trace_path", metavar="TRACE")
@cli.circuit_option()
@click.option(
    "--fix",
    "fixes",
    multiple=True,
    type=_fixed,
    metavar="NAME[=VALUE]",
    help="Hold a parameter, where no value is given at the one of the fit. May be given several times.",
)
@cli.starts_option
@click.option(
    "--replicates",
    type=click.IntRange(0, 1000),
    default=20,
    help="Number of fits to the circuit's own output with added noise.",
)
@cli.seed_option("Of starting points and noise.")
@cli.window_options
@cli.period_option()
@cli.output_options()
def command(
    trace_path: str,
    circuit: str,
    fixes: tuple[tuple[str, float | None], ...],
    starts: int,
    replicates: int,
    seed: int,
    from_s: float | None,
    to_s: float | None,
    period_s: float | None,
    output: cli.Output,
) -> None:
    """Fit a circuit to TRACE and test whether its inputs and output identify its parameters.

    First as the thesis does it: fit the circuit's own output from many starts, and see whether another parameter set
    explains it. Then by what no start can miss: the directions along which the output never changes, and how far each
    parameter may stray before this trace's noise excludes it.
    """
    from ambient_trainer.data.trace import load_trace  # scipy: --help should not wait for it
    from ambient_trainer.estimators.registry import thermal_circuit
    from ambient_trainer.evaluation.identifiability import identifiability
    from ambient_trainer.evaluation.identifiability_report import report_of

    output.check([trace_path, circuit])
    thermal = thermal_circuit(circuit)
    trace = load_trace(trace_path).cut(from_s, to_s)
    with cli.counted_progress() as progress:
        result = identifiability(thermal, trace, dict(fixes), at.Effort(starts, seed), replicates, progress, period_s)
    output.show(report_of(result))
