"""``ambient-trainer identifiability``: what a trace can and cannot tell of a circuit's parameters."""

from __future__ import annotations

import click
from rich.text import Text

from ambient_trainer.cli.number import Finite, FiniteRange
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer, write_figures
from ambient_trainer.cli.progress import counted_progress
from ambient_trainer.data.trace import load_trace
from ambient_trainer.estimators.fit import Effort
from ambient_trainer.estimators.registry import thermal_circuit
from ambient_trainer.evaluation.identifiability import identifiability
from ambient_trainer.evaluation.identifiability_summary import as_json, parameter_table, said, start_table
from ambient_trainer.report.table import for_terminal


@click.command("identifiability")
@click.argument("trace_path", metavar="TRACE")
@click.option("--circuit", "name", required=True, metavar="NAME|FILE", help="A shipped circuit or a .yaml file.")
@click.option(
    "--fix",
    "fixes",
    multiple=True,
    metavar="NAME[=VALUE]",
    help="Hold a parameter, where no value is given at the one of the fit. May be given several times.",
)
@click.option(
    "--starts", type=click.IntRange(1, 1000), default=8, show_default=True, help="Search from so many places."
)
@click.option(
    "--replicates",
    type=click.IntRange(0, 1000),
    default=20,
    show_default=True,
    help="Fit the circuit's own output so many times with noise of its own.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of places and noise.")
@click.option("--from", "from_s", type=Finite(), metavar="S", help="Leave out the samples before this time_s.")
@click.option("--to", "to_s", type=Finite(), metavar="S", help="Leave out the samples from this time_s on.")
@click.option("--period", "period_s", type=FiniteRange(min=1e-3), metavar="S", help="Grid (default: the trace's own).")
@click.option("--json", "json_path", metavar="OUT", help="Write what was found to this file as JSON.")
def command(
    trace_path: str,
    name: str,
    fixes: tuple[str, ...],
    starts: int,
    replicates: int,
    seed: int,
    from_s: float | None,
    to_s: float | None,
    period_s: float | None,
    json_path: str | None,
) -> None:
    """Fit a circuit to TRACE and test whether its parameters can be told from its inputs and output at all.

    First as the thesis does it: fit the circuit's own output from many starts, and see whether another parameter set
    explains it. Then by what no start can miss: the directions along which the output never changes, and how far each
    parameter may stray before this trace's noise excludes it.
    """
    check_outputs([json_path], [trace_path, name])
    fixed = dict(_fix(each) for each in fixes)
    circuit = thermal_circuit(name)
    trace = load_trace(trace_path).cut(from_s, to_s)
    with counted_progress() as progress:
        found = identifiability(circuit, trace, fixed, Effort(starts, seed), replicates, progress, period_s)
    console = printer()
    console.print(for_terminal(start_table(found)))
    console.print(for_terminal(parameter_table(found)))
    for line in said(found):
        console.print(Text(line), soft_wrap=True)
    if json_path is not None:
        write_figures(json_path, as_json(found))


def _fix(text: str) -> tuple[str, float | None]:
    name, equals, value = text.partition("=")
    if not equals:
        return name, None
    try:
        return name, float(value)
    except ValueError:
        raise click.UsageError(f"--fix {text!r}: write NAME or NAME=VALUE, such as C_flash=12") from None
