"""``ambient-trainer simulate``: the trace of a simulated phone in one of the thesis's scenarios."""

from __future__ import annotations

import time

import click
from rich.console import Console
from rich.progress import Progress

from ambient_trainer.simulation.scenario import scenario_names

_PATIENCE_S = 1.0


@click.command("simulate")
@click.argument("scenario", type=click.Choice(scenario_names()), metavar="SCENARIO")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Another one, another noise.")
@click.option(
    "--period",
    "period_s",
    type=click.FloatRange(min=0.1, max=60.0),
    default=1.0,
    show_default=True,
    help="Seconds between samples.",
)
@click.option("--zones", is_flag=True, help="All of the phone's zones, about 50, not only the thesis's five sensors.")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False), help="The trace; .gz compresses it.")
def command(scenario: str, seed: int, period_s: float, zones: bool, output: str) -> None:
    """Write what a simulated phone would log in SCENARIO: 1, 2.1 to 2.5, 3, 4 or 5 of the thesis.

    The same SCENARIO, seed and period give the same file.
    """
    from ambient_trainer.simulation.phone import simulate, simulate_zones  # scipy: --help should not wait for it
    from ambient_trainer.traces.trace import save_trace

    console = Console(stderr=True, highlight=False)
    started_s = time.monotonic()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"scenario {scenario}", visible=False)

        def show(done: int, total: int) -> None:
            visible = time.monotonic() - started_s > _PATIENCE_S
            bar.update(task, completed=done, total=total, visible=visible)

        trace = (simulate_zones if zones else simulate)(scenario, seed, period_s, show)
    save_trace(output, trace)
    click.echo(f"wrote {output}: {len(trace.time_s)} simulated samples, one every {period_s:g} s")
