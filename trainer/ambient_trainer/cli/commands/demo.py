"""``ambient-trainer demo``: the whole path on a simulated phone, with no data and nothing to set up."""

import subprocess
import sys

import click

import ambient_trainer as at
from ambient_model.codec import save_model
from ambient_model.faults import refuse
from ambient_trainer import cli
from ambient_trainer.report.files import made_folder

_CIRCUITS = ("linear_combined", "model2_ss", "model2_ss_free_cd", "free-2")
_EXPORTED = "free-2"
_TRAINING, _VERIFICATION = "5", "4"


@click.command("demo")
@click.option("-o", "--output", "folder", default="out", metavar="DIR", help="Where the files go.")
def command(folder: str) -> None:
    """Simulate a phone, fit circuits to it, score them on another run, and let the daemon replay that run.

    Every figure it prints is of simulated data.
    """
    import pandas as pd  # this and the others: --help should not wait for them
    from rich.console import Console

    from ambient_trainer.data.trace import load_trace
    from ambient_trainer.evaluation.compare import Split, fit_and_score, report_of

    place = made_folder(folder)
    training, verification = str(place / "training.csv"), str(place / "verification.csv")
    model_path, replayed = str(place / "model.json"), str(place / "replay.csv")
    click.echo(f"1. A simulated phone goes through the thesis's scenario {_TRAINING} (training) and {_VERIFICATION}.")
    with Console(stderr=True).status("simulating 16 hours"):
        at.simulate(_TRAINING, seed=0).save(training)
        at.simulate(_VERIFICATION, seed=1).save(verification)
    click.echo("2. Circuits are fitted to the first run and scored on the second, which none of them saw.")
    contest = Split([load_trace(training)], load_trace(verification))
    contenders, effort = [], at.Effort()
    for name in _CIRCUITS:
        with cli.fit_progress(name, effort, effort.starts, contest.samples) as progress:
            contenders.append(fit_and_score(name, contest, (), effort, progress))
    cli.Output().show(report_of(contenders))
    exported = next(each for each in contenders if each.fit.circuit == _EXPORTED)
    save_model(model_path, exported.model)
    click.echo(f"3. {_EXPORTED} is exported: {model_path}")
    # as the program it is on a device: another process, which has never heard of numpy
    call = [sys.executable, "-m", "ambientd", "replay", model_path, verification, "-o", replayed]
    done = subprocess.run(call, capture_output=True, text=True)
    if done.returncode:
        problem = done.stderr.strip() or f"status {done.returncode}"
        raise refuse("ambientd replay", "", problem, "report this as a fault")
    error_degC = contest.held_out.reference - pd.read_csv(replayed)["ambient_degC"]
    rmse = float((error_degC**2).mean()) ** 0.5
    click.echo(f"4. ambientd replays the second run, as on a device: {replayed}, {rmse:.2f} degC off (RMSE, simulated)")
    page = at.EvaluationResult(exported.model, (exported.running,)).report(str(place / "report"))
    click.echo(f"5. Report: {page}")
