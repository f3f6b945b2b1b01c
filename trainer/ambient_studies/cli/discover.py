"""``ambient-trainer discover``: hide effects in simulated devices, and count what the diagnosis finds of them."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import click

from ambient_trainer.cli import Output, counted_progress, jobs_option, output_options

if TYPE_CHECKING:
    from ambient_studies.discovery.runner import Done
    from ambient_trainer.circuits import Circuit

# The diagnosis was tuned on seeds below 1000: by default the figures are of cases that tuned nothing.
_SEED = 5000
_CASES = 300


@click.command("discover")
@click.option("--cases", "count", type=click.IntRange(1, 100_000), default=_CASES, help="So many.")
@click.option("--seed", type=click.IntRange(min=0), default=_SEED, help="Another one, other cases.")
@click.option("--device", default="phone", show_default=True, metavar="NAME", help="phone or set_top_box, simulated.")
@click.option(
    "--circuit",
    "circuit_name",
    metavar="NAME|FILE",
    help="What diagnoses: a shipped circuit or a .yaml file.  [default: the device's own]",
)
@output_options("the figures and every case", page=True)
@jobs_option("Cases at a time.")
def command(count: int, seed: int, device: str, circuit_name: str | None, output: Output, jobs: int) -> None:
    """Measure what a diagnosis finds: hide effects in simulated devices, diagnose them, count.

    The circuit is trained once on known-good runs. Then each case - scenario 5, or the device's own, with nothing, one
    or two effects hidden in it, of every cause and several sizes, beside signals that drive nothing - is diagnosed by
    its trace alone. The same seed draws the same cases; interrupted, it shows those that are done.
    """
    from ambient_studies.discovery.report import as_json, case_json, report_of  # scipy: --help should not wait for it
    from ambient_trainer.estimators import thermal_circuit
    from ambient_trainer.simulator import device_names

    if device not in device_names():
        known = ", ".join(device_names())
        raise click.BadParameter(
            f"no simulated device is called {device!r}; take one of {known}", param_hint="--device"
        )
    output.check([circuit_name or device])
    circuit = thermal_circuit(circuit_name or device)
    _require_sensors(circuit, device)
    done: list[Done] = []
    try:
        _collect(done, circuit, device, seed, count, jobs)
    except KeyboardInterrupt:
        if not done:
            raise
    outcomes = [each.outcome for each in done]
    each = [case_json(one) for one in done]
    about = {"seed": seed, "device": device, "circuit": circuit.name}
    output.show(report_of(outcomes, {**about, **as_json(outcomes), "each": each}))
    if len(done) < count:
        raise click.ClickException(f"interrupted after {len(done)} of {count} cases: the figures are of these")


def _require_sensors(circuit: Circuit, device: str) -> None:
    """An effect in a sensor that the circuit does not read cannot be found."""
    from ambient_trainer.simulator import load_device

    sensors = load_device(device).sensors
    unread = set(sensors) - {node.sensor for node in circuit.states}
    if unread:
        raise click.UsageError(
            f"{circuit.name}: no node with a capacitance is read by {', '.join(sorted(unread))}; "
            f"take a circuit that reads {', '.join(sensors)}"
        )


def _collect(done: list[Done], circuit: Circuit, device: str, seed: int, count: int, jobs: int) -> None:
    """Add to ``done`` case by case, so that an interruption leaves those that are through."""
    from ambient_studies.discovery.cases import baselines, draw_cases
    from ambient_studies.discovery.runner import run, train

    with counted_progress() as progress:
        progress("training the circuit", 0, count)
        bench = train(circuit, baselines(seed, device))
        with contextlib.closing(run(bench, draw_cases(seed, count, device), jobs)) as cases:
            for each in cases:
                done.append(each)
                right = sum(one.outcome.correct for one in done)
                progress(f"diagnosing, {right} right", len(done), count)
