"""``ambient-trainer diagnose``: what a circuit gets wrong about traces, its cause, and what adding that gains."""

from __future__ import annotations

import time

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from ambient_trainer.cli.effort import jobs_option
from ambient_trainer.cli.number import Finite, FiniteRange
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer, write_figures, write_page
from ambient_trainer.data.trace import load_trace

_PATIENCE_S = 1.0


@click.command("diagnose")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@click.option(
    "--circuit", "circuit_name", required=True, metavar="NAME|FILE", help="A shipped circuit or a .yaml file."
)
@click.option(
    "--baseline",
    "baseline_paths",
    multiple=True,
    metavar="TRACE",
    help="A known-good trace of the same device: the question is then what changed since. May be given often.",
)
@click.option("--from", "from_s", type=Finite(), metavar="S", help="Leave out the samples before this time_s.")
@click.option("--to", "to_s", type=Finite(), metavar="S", help="Leave out the samples from this time_s on.")
@click.option(
    "--period", "period_s", type=FiniteRange(min=1e-3), metavar="S", help="Grid (default: at most 2000 samples)."
)
@click.option("--json", "json_path", metavar="OUT", help="Write what is said to this file as JSON.")
@click.option("--report", "report_folder", metavar="DIR", help="Write a page with plots into this folder.")
@click.option("--extended", "extended_path", metavar="FILE.yaml", help="Write the circuit with what was found.")
@jobs_option("Candidates at a time.")
def command(
    trace_paths: tuple[str, ...],
    circuit_name: str,
    baseline_paths: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    period_s: float | None,
    json_path: str | None,
    report_folder: str | None,
    extended_path: str | None,
    jobs: int,
) -> None:
    """Show where TRACE and the simulated circuit part, name the cause, and measure what adding it gains.

    The circuit is simulated forward: ambient and drives in, every sensor out. With --baseline it is trained by
    known-good traces, and the question is what changed; without, the question is what the circuit lacks.
    """
    from joblib import parallel_config

    from ambient_trainer.circuits.write import save_circuit
    from ambient_trainer.diagnosis.diagnose import diagnose
    from ambient_trainer.diagnosis.summary import as_json, show
    from ambient_trainer.estimators.registry import thermal_circuit

    check_outputs([json_path, extended_path], [*trace_paths, *baseline_paths, circuit_name], report_folder)
    circuit = thermal_circuit(circuit_name)
    traces = [load_trace(path).cut(from_s, to_s) for path in trace_paths]
    baselines = [load_trace(path) for path in baseline_paths]
    with _Bar() as bar, parallel_config(n_jobs=jobs):
        found = diagnose(circuit, traces, baselines, bar.show, period_s)
    console = printer()
    show(console, found)
    if json_path is not None:
        write_figures(json_path, as_json(found))
    if extended_path is not None:
        if found.extended is None:
            click.echo("Nothing was found that a circuit can hold: no circuit is written.")
        else:
            save_circuit(extended_path, found.extended)
            click.echo(f"Circuit: {extended_path}")
    if report_folder is not None:
        from ambient_trainer.diagnosis.page import diagnosis_page

        write_page(report_folder, diagnosis_page(found))


class _Bar:
    """A bar for whoever waits at a terminal, one task a stage."""

    def __init__(self) -> None:
        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        self._console = Console(stderr=True)
        self._progress = Progress(
            *columns, console=self._console, transient=True, disable=not self._console.is_terminal
        )
        self._task = self._progress.add_task("", visible=False)
        self._started_s = time.monotonic()

    def __enter__(self) -> _Bar:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, stage: str, done: int, total: int) -> None:
        """``done`` of ``total`` of a stage are through."""
        visible = time.monotonic() - self._started_s > _PATIENCE_S
        self._progress.update(self._task, description=stage, completed=done, total=total, visible=visible)
