"""``ambient-trainer compare``: which circuit to take, on data that none of them was fitted to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

import ambient_trainer as at
from ambient_model.codec import save_model
from ambient_model.faults import refuse
from ambient_trainer import cli
from ambient_trainer.cli.commands.fit import STOPPED

if TYPE_CHECKING:
    from ambient_trainer.evaluation.compare import ScoredFit


@click.command("compare")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@cli.circuit_option("As in fit; repeat it.", multiple=True)
@click.option("--split", "split_s", type=cli.Finite(), metavar="S", help="Train before this time_s, score after it.")
@click.option("--held-out", "held_out", metavar="TRACE", help="Score on this trace instead.")
@cli.sensors_option(meaning="As in fit.")
@click.option("--models", metavar="DIR", help="Write each model into this folder, as CIRCUIT.json.")
@cli.output_options()
@cli.effort_options
def command(
    trace_paths: tuple[str, ...],
    circuit: tuple[str, ...],
    split_s: float | None,
    held_out: str | None,
    sensors: tuple[str, ...],
    models: str | None,
    output: cli.Output,
    effort: at.Effort,
) -> int:
    """Fit several circuits to TRACEs and score them, beside the static formula, on data that none of them saw.

    Ctrl-C shows those that are done.
    """
    from ambient_trainer.api.data import sensor_columns  # scipy: --help should not wait for it
    from ambient_trainer.data.trace import load_trace, sha256_of
    from ambient_trainer.estimators.registry import estimator
    from ambient_trainer.evaluation.compare import Split, fit_and_score, report_of, split_at

    if models is not None and not Path(models).is_dir():
        raise refuse(models, "", "is no folder", "make it first")
    written = [str(Path(models) / f"{Path(name).stem}.json") for name in circuit] if models is not None else []
    output.check([*trace_paths, *circuit, *([held_out] if held_out else [])], written)
    if (split_s is None) == (held_out is None):
        raise click.UsageError("give either --split S or --held-out TRACE: a score needs data that no fit saw")
    if split_s is not None and len(trace_paths) > 1:
        raise click.UsageError("--split cuts one trace; with several, name another one with --held-out")
    for name in circuit:
        estimator(name)  # a wrong name should not cost the fits before it
    traces = [load_trace(path) for path in trace_paths]
    contest = split_at(traces[0], split_s) if split_s is not None else Split(traces, load_trace(str(held_out)))
    if held_out is not None and sha256_of(held_out) in map(sha256_of, trace_paths):
        raise click.UsageError(f"{held_out} is a training trace too: hold out another one, or use --split")
    contenders: list[ScoredFit] = []
    for name in circuit:
        with cli.fit_progress(name, effort, effort.starts, contest.samples) as progress:
            contenders.append(fit_and_score(name, contest, sensor_columns(sensors), effort, progress))
        if models is not None:
            save_model(written[len(contenders) - 1], contenders[-1].model)
        if contenders[-1].fit.stopped:
            break
    output.show(report_of(contenders))
    return STOPPED if contenders[-1].fit.stopped else 0
