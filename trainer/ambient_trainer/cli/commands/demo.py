"""``ambient-trainer demo``: the whole path on a simulated phone, with no data and nothing to set up."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ambient_model.codec import save_model
from ambient_model.faults import refuse
from ambient_trainer import cli

if TYPE_CHECKING:
    from ambient_trainer.evaluation.compare import Contender

_CIRCUITS = ("linear_combined", "model2_ss", "model2_ss_free_cd", "free-2")
_EXPORTED = "free-2"
_TRAINING, _VERIFICATION = "5", "4"


@click.command("demo")
@click.option("-o", "--output", "folder", default="out", metavar="DIR", help="Where the files go.")
def command(folder: str) -> None:
    """Simulate a phone, fit circuits to it, score them on another run, and let the daemon replay that run.

    Every figure it prints is of simulated data.
    """
    from rich.console import Console  # this and scipy: --help should not wait for them

    from ambient_trainer.data.trace import load_trace, save_trace
    from ambient_trainer.estimators.base import Effort
    from ambient_trainer.evaluation.compare import Contest, contend, report_of
    from ambient_trainer.simulator import simulate

    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refuse(folder, "", f"cannot be made ({error.strerror})", "name another folder with -o") from error
    training, verification = Path(folder) / "training.csv", Path(folder) / "verification.csv"
    model_path, replayed = Path(folder) / "model.json", Path(folder) / "replay.csv"
    click.echo(f"1. A simulated phone goes through the thesis's scenario {_TRAINING} (training) and {_VERIFICATION}.")
    with Console(stderr=True).status("simulating 16 hours"):
        save_trace(str(training), simulate(_TRAINING, seed=0).trace)
        save_trace(str(verification), simulate(_VERIFICATION, seed=1).trace)
    click.echo("2. Circuits are fitted to the first run and scored on the second, which none of them saw.")
    contest = Contest([load_trace(str(training))], load_trace(str(verification)))
    contenders, effort = [], Effort()
    for name in _CIRCUITS:
        with cli.fit_progress(name, effort, effort.starts, contest.samples) as progress:
            contenders.append(contend(name, contest, (), effort, progress))
    cli.Output().show(report_of(contenders))
    exported = next(each for each in contenders if each.fit.circuit == _EXPORTED)
    save_model(str(model_path), exported.model)
    click.echo(f"3. {_EXPORTED} is exported: {model_path}")
    _replay(model_path, verification, replayed)
    rmse = _rmse_of_replay(verification, replayed)
    click.echo(f"4. ambientd replays the second run, as on a device: {replayed}, {rmse:.2f} degC off (RMSE, simulated)")
    click.echo(f"5. Report: {_report(folder, exported)}")


def _replay(model: Path, trace: Path, output: Path) -> None:
    """Run the daemon as the program it is on a device: another process, which has never heard of numpy."""
    done = subprocess.run(
        [sys.executable, "-m", "ambientd", "replay", str(model), str(trace), "-o", str(output)],
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise refuse(
            "ambientd replay", "", done.stderr.strip() or f"status {done.returncode}", "report this as a fault"
        )


def _rmse_of_replay(trace_path: Path, replay_path: Path) -> float:
    import numpy as np

    from ambient_trainer.data.trace import load_trace

    reference = load_trace(str(trace_path)).reference
    estimate = np.genfromtxt(str(replay_path), np.float64, delimiter=",", skip_header=1, usecols=(1,))
    return float(np.sqrt(np.nanmean((reference - estimate) ** 2)))


def _report(folder: str, exported: Contender) -> str:
    from ambient_trainer.evaluation.report import report_of
    from ambient_trainer.report.page import write_report

    return write_report(str(Path(folder) / "report"), report_of(exported.model, [exported.running]))
