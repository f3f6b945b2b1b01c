"""``ambient-trainer diagnose``: what a circuit gets wrong about traces, its cause, and what adding that gains."""

from __future__ import annotations

import click

from ambient_trainer.cli.options import circuit_option, jobs_option, output_options, period_option, window_options
from ambient_trainer.cli.output import Output
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.data.trace import load_trace


@click.command("diagnose")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@circuit_option()
@click.option(
    "--baseline",
    "baseline_paths",
    multiple=True,
    metavar="TRACE",
    help="A known-good trace of the same device: the question is then what changed since. May be given often.",
)
@window_options
@period_option("at most 2000 samples")
@output_options("the diagnosis", page=True)
@click.option("--extended", "extended_path", metavar="FILE.yaml", help="Write the circuit with what was missing.")
@jobs_option("Candidates at a time.")
def command(
    trace_paths: tuple[str, ...],
    circuit: str,
    baseline_paths: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    period_s: float | None,
    output: Output,
    extended_path: str | None,
    jobs: int,
) -> None:
    """Show where TRACE and the simulated circuit part, name the cause, and measure what adding it gains.

    The circuit is simulated forward: ambient and drives in, every sensor out. With --baseline it is fitted to
    known-good traces, and the question is what changed; without, the question is what the circuit lacks.
    """
    from joblib import parallel_config

    from ambient_trainer.circuits.write import save_circuit
    from ambient_trainer.diagnosis.diagnose import diagnose
    from ambient_trainer.diagnosis.report import report_of
    from ambient_trainer.estimators.registry import thermal_circuit

    output.check([*trace_paths, *baseline_paths, circuit], [extended_path])
    thermal = thermal_circuit(circuit)
    traces = [load_trace(path).cut(from_s, to_s) for path in trace_paths]
    baselines = [load_trace(path) for path in baseline_paths]
    with staged_progress() as progress, parallel_config(n_jobs=jobs):
        result = diagnose(thermal, traces, baselines, progress, period_s)
    output.show(report_of(result))
    if extended_path is not None:
        if result.extended is None:
            click.echo("No cause is one that a circuit can hold: no circuit is written.")
        else:
            save_circuit(extended_path, result.extended)
            click.echo(f"Circuit: {extended_path}")
