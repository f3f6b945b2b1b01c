"""``ambient-trainer fit``: traces and a circuit become a model file, with what the data say of the circuit."""

from __future__ import annotations

import click
import numpy as np
from rich.console import Console

from ambient_model.codec import save_model
from ambient_model.trace import REFERENCE
from ambient_trainer.cli.effort import effort_options
from ambient_trainer.cli.interrupt import interruptible
from ambient_trainer.cli.number import Finite, FiniteRange
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import write_figures
from ambient_trainer.cli.progress import fit_progress
from ambient_trainer.data.trace import load_trace
from ambient_trainer.estimators.fit import Effort
from ambient_trainer.estimators.model_file import model_of, training_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.estimators.summary import as_json, facts, headline, parameter_table
from ambient_trainer.report.table import for_terminal

STOPPED = 1


@click.command("fit")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@click.option(
    "--circuit",
    required=True,
    metavar="NAME|FILE",
    help="A shipped circuit or observer, a .yaml file, or free-1 to free-4.",
)
@click.option("-o", "--output", required=True, metavar="MODEL.json", help="Where the model goes.")
@click.option("--from", "from_s", type=Finite(), metavar="S", help="Leave out the samples before this time_s.")
@click.option("--to", "to_s", type=Finite(), metavar="S", help="Leave out the samples from this time_s on.")
@click.option("--json", "json_path", metavar="FIT.json", help="Write what the terminal shows to this file as JSON.")
@click.option(
    "--sensors",
    metavar="A,B,...",
    help="What free-N, circuit_observer and free_observer read (default: every _degC column).",
)
@click.option(
    "--zone", "zones", multiple=True, metavar="NAME=TYPE", help="The thermal zone's type, where it is not the name."
)
@click.option("--period", "period_s", type=FiniteRange(min=1e-3), metavar="S", help="Grid (default: the trace's own).")
@effort_options
def command(
    trace_paths: tuple[str, ...],
    circuit: str,
    output: str,
    from_s: float | None,
    to_s: float | None,
    json_path: str | None,
    sensors: str | None,
    zones: tuple[str, ...],
    period_s: float | None,
    effort: Effort,
) -> int:
    """Fit a circuit to one or several TRACEs that hold ambient_degC, and export it for a device.

    Ctrl-C ends the search and keeps the best so far, marked so in the file.
    """
    zone_types = dict(_pair(each) for each in zones)
    check_outputs([output, json_path], [*trace_paths, circuit])
    columns = sensor_columns(sensors)
    method = estimator(circuit, columns)
    traces = [load_trace(path).cut(from_s, to_s) for path in trace_paths]
    samples = sum(int(np.count_nonzero(~np.isnan(trace.reference))) for trace in traces if REFERENCE in trace.columns)
    searches = method.searches(effort)
    with interruptible(effort.budget.cancel), fit_progress(circuit, searches, samples) as progress:
        fit = method.fit(traces, effort, progress, period_s, columns or None)
    model = model_of(fit, [training_of(trace, from_s, to_s) for trace in traces], zone_types)
    save_model(output, model)
    console = Console()
    console.print(headline(fit), soft_wrap=True, highlight=False)
    console.print(for_terminal(parameter_table(fit)))
    for line in facts(fit):
        console.print(line, soft_wrap=True, highlight=False, markup=False)
    periods = ", ".join(f"{each.period_s:g}" for each in model.main.discrete)
    click.echo(f"Model: {output}, {len(fit.states)} states, for periods of {periods} s")
    if json_path is not None:
        write_figures(json_path, as_json(fit))
    return STOPPED if fit.stopped else 0


def sensor_columns(text: str | None) -> tuple[str, ...]:
    """The trace columns that a list such as ``usb,battery`` names."""
    names = [name.strip() for name in (text or "").split(",") if name.strip()]
    return tuple(name if name.endswith("_degC") else f"{name}_degC" for name in names)


def _pair(text: str) -> tuple[str, str]:
    name, _, zone = text.partition("=")
    if not name or not zone:
        raise click.UsageError(f"--zone {text!r}: write NAME=TYPE, such as usb=usb-therm")
    return name, zone
