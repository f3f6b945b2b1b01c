"""``ambient-trainer collect``: run a campaign in the laboratory, or in a simulated one, and leave a trace."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

import click

import ambient_trainer as at
from ambient_model.faults import Fault
from ambient_trainer import cli
from ambient_trainer.cli.progress import handled

if TYPE_CHECKING:
    from ambient_trainer.laboratory.campaign import LoadedCampaign
    from ambient_trainer.laboratory.collect import Job

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@click.command("collect")
@click.argument("campaign", metavar="CAMPAIGN.yaml|SCENARIO")
@click.option(
    "-o", "--output", metavar="TRACE.csv", type=click.Path(dir_okay=False), help="The trace; .gz compresses it."
)
@click.option("--simulate", is_flag=True, help="Simulated instruments and a simulated phone in the place of real ones.")
@click.option(
    "--speed", type=cli.FiniteRange(min=0.1, max=1000.0), show_default="1", help="With --simulate: times real time."
)
@click.option("--seed", type=click.IntRange(min=0), show_default="0", help="With --simulate: of the noise.")
@click.option("--resume", is_flag=True, help="Go on with the run that was stopped before its end.")
@click.option("--dry-run", is_flag=True, help="Only print the schedule and the length.")
def command(
    campaign: str, output: str | None, simulate: bool, resume: bool, dry_run: bool, **simulation: float | None
) -> int:
    """Run a campaign: chamber, probes and device through a program, all of it into one trace.

    SCENARIO is 1, 2.1 to 2.5, 3, 4 or 5 of the thesis. Every sample is on the disk within seconds, in TRACE.csv.part,
    until the trace is whole; --resume goes on with it after a power loss. The instruments' own readings go into
    TRACE.laboratory.csv.

    However a run ends, the chamber goes to its safe set point first. Ctrl-C ends it; a second one gives up waiting for
    the chamber to confirm that.
    """
    from ambient_trainer.laboratory.campaign import load_campaign
    from ambient_trainer.laboratory.report import schedule_report
    from ambient_trainer.simulator.scenario import scenario_path

    given = {name: value for name, value in simulation.items() if value is not None}
    if given and not simulate:
        raise click.UsageError("--speed and --seed are for --simulate: a real laboratory has a time of its own")
    if not dry_run and output is None:
        raise click.UsageError("say where the trace goes: -o TRACE.csv")
    try:
        path = scenario_path(campaign)
    except at.Refused as refused:
        raise click.UsageError(str(refused)) from refused
    loaded = load_campaign(path, ports=not (simulate or dry_run))
    if dry_run:
        cli.Output().show(schedule_report(loaded))
        return 0
    assert output is not None
    from ambient_trainer.laboratory.collect import Job, journal_path, laboratory_path

    cli.Output().check(loaded.files, [output, laboratory_path(output)])
    if resume and not os.path.exists(journal_path(output)):
        fault = Fault(journal_path(output), "there is no run to resume", "leave --resume out, or name its output")
        raise click.UsageError(str(fault))
    with _simulated(loaded, output, **given) if simulate else nullcontext(Job(loaded, output)) as job:
        return _run(job, resume)


@contextmanager
def _simulated(loaded: LoadedCampaign, output: str, speed: float = 1.0, seed: float = 0) -> Iterator[Job]:
    from ambient_trainer.laboratory.collect import Job
    from ambient_trainer.laboratory.messages import Clock
    from ambient_trainer.laboratory.simulation import simulated_laboratory

    with simulated_laboratory(loaded, Clock(speed), int(seed)) as there:
        yield Job(there.loaded, output, speed, True, there.environment)


def _run(job: Job, again: bool) -> int:
    from ambient_trainer.cli.monitor import monitor_of
    from ambient_trainer.laboratory.collect import collect, resume
    from ambient_trainer.laboratory.report import collection_report, problems_of
    from ambient_trainer.laboratory.run import Supervision

    # they end nothing by themselves; one that is ignored stays so: nohup means it
    caught: list[int] = []
    wanted = [each for each in _SIGNALS if signal.getsignal(each) is not signal.SIG_IGN]
    with handled(lambda number, _: caught.append(number), *wanted), monitor_of(cli.printer(), job) as monitor:
        supervision = Supervision(
            monitor.update,
            monitor.event,
            lambda: f"stopped by {signal.Signals(caught[0]).name}" if caught else None,
            lambda: caught.count(signal.SIGINT) > 1,
        )
        collected = (resume if again else collect)(job, supervision)
    cli.Output().show(collection_report(collected, job))
    for problem in problems_of(collected.outcome, job):
        click.echo(f"ambient-trainer: {problem}", err=True)
    outcome = collected.outcome
    return 0 if outcome.finished and outcome.alarm is None and outcome.safe else 1
