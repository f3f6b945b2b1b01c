"""``ambient-trainer fit``: traces and a circuit become a model file, with what the data say of the circuit."""

from __future__ import annotations

from typing import Any

import click

import ambient_trainer as at
from ambient_model.trace import REFERENCE
from ambient_trainer import cli

STOPPED = 1


@click.command("fit")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@cli.circuit_option("A shipped circuit or observer, a .yaml file, or free-1 to free-4.")
@click.option("-o", "--output", "model_path", required=True, metavar="MODEL.json", help="Where the model goes.")
@cli.window_options
@cli.output_options("what the terminal shows")
@cli.sensors_option()
@click.option(
    "--zone",
    "zones",
    multiple=True,
    type=cli.assigned("NAME=TYPE, such as usb=usb-therm"),
    metavar="NAME=TYPE",
    help="The thermal zone's type, where it is not the name.",
)
@click.option(
    "--resolution",
    "resolution",
    multiple=True,
    type=cli.assigned("SENSOR=STEP, such as battery=1", float),
    metavar="SENSOR=STEP",
    help="The device reads this sensor in steps of so many degC: train as if the log did.",
)
@cli.period_option()
@cli.effort_options
def command(
    trace_paths: tuple[str, ...], circuit: str, model_path: str, output: cli.Output, effort: at.Effort, **data: Any
) -> int:
    """Fit a circuit to one or several TRACEs that hold ambient_degC, and export it for a device.

    Ctrl-C ends the search and keeps the best so far, marked so in the file.
    """
    import numpy as np  # --help should not wait for it

    from ambient_trainer.api.data import sensor_columns
    from ambient_trainer.data.trace import load_trace
    from ambient_trainer.estimators.registry import estimator

    output.check([*trace_paths, circuit], [model_path])
    whole, to_s = [load_trace(path) for path in trace_paths], data["to_s"]
    if to_s is not None and (end_s := max(float(trace.time_s[-1]) for trace in whole)) < to_s:
        click.echo(f"ambient-trainer: --to {to_s:.10g} leaves out nothing: the log ends at {end_s:.10g} s", err=True)
    traces = [trace.cut(data["from_s"], to_s) for trace in whole]
    samples = sum(int(np.isfinite(trace.reference).sum()) for trace in traces if REFERENCE in trace.columns)
    searches = estimator(circuit, sensor_columns(data["sensors"])).searches(effort)
    data |= {name: dict(data[name]) for name in ("zones", "resolution")}
    with cli.fit_progress(circuit, effort, searches, samples) as progress:
        result = at.fit(traces, circuit, effort=effort, progress=progress, **data)
    result.save(model_path)
    output.show(result.summary)
    periods = ", ".join(f"{each.period_s:g}" for each in result.model.main.discrete)
    click.echo(f"Model: {model_path}, {len(result.fitted.states)} states, for periods of {periods} s")
    return STOPPED if result.fitted.stopped else 0
