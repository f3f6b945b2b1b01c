"""``ambient-trainer fit``: traces and a circuit become a model file, with what the data say of the circuit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ambient_model.trace import REFERENCE
from ambient_trainer.cli.interrupt import interruptible
from ambient_trainer.cli.options import (
    circuit_option,
    effort_options,
    output_options,
    period_option,
    sensor_columns,
    window_options,
)
from ambient_trainer.cli.output import Output
from ambient_trainer.cli.progress import fit_progress

if TYPE_CHECKING:
    from ambient_trainer.estimators.base import Effort

STOPPED = 1


@click.command("fit")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@circuit_option("A shipped circuit or observer, a .yaml file, or free-1 to free-4.")
@click.option("-o", "--output", "model_path", required=True, metavar="MODEL.json", help="Where the model goes.")
@window_options
@output_options("what the terminal shows")
@click.option(
    "--sensors",
    metavar="A,B,...",
    help="What free-N, circuit_observer and free_observer read (default: every _degC column).",
)
@click.option(
    "--zone", "zones", multiple=True, metavar="NAME=TYPE", help="The thermal zone's type, where it is not the name."
)
@click.option(
    "--resolution",
    "resolutions",
    multiple=True,
    metavar="SENSOR=STEP",
    help="The device reads this sensor in steps of so many degC: train as if the log did.",
)
@period_option()
@effort_options
def command(
    trace_paths: tuple[str, ...],
    circuit: str,
    model_path: str,
    output: Output,
    sensors: str | None,
    zones: tuple[str, ...],
    resolutions: tuple[str, ...],
    effort: Effort,
    **grid: Any,
) -> int:
    """Fit a circuit to one or several TRACEs that hold ambient_degC, and export it for a device.

    Ctrl-C ends the search and keeps the best so far, marked so in the file.
    """
    import numpy as np  # --help should not wait for it

    from ambient_trainer.api.fitting import fit
    from ambient_trainer.data.trace import load_trace
    from ambient_trainer.estimators.registry import estimator

    zone_types = dict(_pair("--zone", each, "NAME=TYPE, such as usb=usb-therm") for each in zones)
    steps = dict(_step(each) for each in resolutions)
    output.check([*trace_paths, circuit], [model_path])
    traces = [load_trace(path).cut(grid["from_s"], grid["to_s"]) for path in trace_paths]
    samples = sum(int(np.count_nonzero(~np.isnan(trace.reference))) for trace in traces if REFERENCE in trace.columns)
    searches = estimator(circuit, sensor_columns(sensors)).searches(effort)
    with interruptible(effort.budget.cancel), fit_progress(circuit, searches, samples) as progress:
        chosen: dict[str, Any] = {"sensors": sensor_columns(sensors), "zones": zone_types, "effort": effort}
        result = fit(traces, circuit, **chosen, **grid, resolution=steps, progress=progress)
    result.save(model_path)
    output.show(result.summary)
    periods = ", ".join(f"{each.period_s:g}" for each in result.model.main.discrete)
    click.echo(f"Model: {model_path}, {len(result.fitted.states)} states, for periods of {periods} s")
    return STOPPED if result.fitted.stopped else 0


def _pair(option: str, text: str, form: str) -> tuple[str, str]:
    name, _, value = text.partition("=")
    if not name or not value:
        raise click.UsageError(f"{option} {text!r}: write {form}")
    return name, value


def _step(text: str) -> tuple[str, float]:
    form = "SENSOR=STEP, such as battery=1"
    name, step = _pair("--resolution", text, form)
    try:
        return name, float(step)
    except ValueError:
        raise click.UsageError(f"--resolution {text!r}: write {form}") from None
