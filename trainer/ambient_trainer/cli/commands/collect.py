"""``ambient-trainer collect``: run a campaign in the laboratory, or in a simulated one, and leave a trace."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from ambient_model.faults import Fault, Refused
from ambient_trainer.cli.number import FiniteRange
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer
from ambient_trainer.report.table import for_terminal
from ambient_trainer.simulator.scenario import scenario_path

if TYPE_CHECKING:
    from rich.console import Console

    from ambient_trainer.laboratory.campaign import Loaded
    from ambient_trainer.laboratory.collect import Collected, Job
    from ambient_trainer.laboratory.conductor import Eyes

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@click.command("collect")
@click.argument("campaign", metavar="CAMPAIGN.yaml|SCENARIO")
@click.option(
    "-o", "--output", metavar="TRACE.csv", type=click.Path(dir_okay=False), help="The trace; .gz compresses it."
)
@click.option("--simulate", is_flag=True, help="Simulated instruments and a simulated phone in the place of real ones.")
@click.option("--speed", type=FiniteRange(min=0.1, max=1000.0), help="With --simulate: times real time.  [default: 1]")
@click.option("--seed", type=click.IntRange(min=0), help="With --simulate: another one, another noise.  [default: 0]")
@click.option("--resume", is_flag=True, help="Go on with the run that was stopped before its end.")
@click.option("--dry-run", is_flag=True, help="Only print the schedule and the length.")
def command(
    campaign: str,
    output: str | None,
    simulate: bool,
    speed: float | None,
    seed: int | None,
    resume: bool,
    dry_run: bool,
) -> int:
    """Run a campaign: chamber, probes and device through a program, all of it into one trace.

    SCENARIO is 1, 2.1 to 2.5, 3, 4 or 5 of the thesis. Every sample is on the disk within seconds, in TRACE.csv.part,
    until the trace is whole; --resume goes on with it after a power loss. What the instruments said themselves goes
    into TRACE.laboratory.csv.

    However a run ends, the chamber goes to its safe set point first. Ctrl-C ends it; a second one gives up waiting for
    the chamber to confirm that.
    """
    from ambient_trainer.laboratory.campaign import load_campaign

    if not simulate and (speed is not None or seed is not None):
        raise click.UsageError("--speed and --seed are for --simulate: a real laboratory has a time of its own")
    if not dry_run and output is None:
        raise click.UsageError("say where the trace goes: -o TRACE.csv")
    try:
        path = scenario_path(campaign)
    except Refused as refused:
        raise click.UsageError(str(refused)) from refused
    loaded = load_campaign(path, ports=not (simulate or dry_run))
    if dry_run:
        _print_schedule(loaded)
        return 0
    assert output is not None
    from ambient_trainer.laboratory.collect import journal_path, laboratory_path

    check_outputs([output, laboratory_path(output)], loaded.files)

    if resume and not os.path.exists(journal_path(output)):
        fault = Fault(journal_path(output), "there is no run to resume", "leave --resume out, or name its output")
        raise click.UsageError(str(fault))
    with _job(loaded, output, simulate, speed or 1.0, seed or 0) as job:
        return _run(job, resume)


@contextlib.contextmanager
def _job(loaded: Loaded, output: str, simulate: bool, speed: float, seed: int) -> Iterator[Job]:
    from ambient_trainer.laboratory.clock import FastClock, RealClock
    from ambient_trainer.laboratory.collect import Job

    if not simulate:
        yield Job(loaded, output, RealClock())
        return
    from ambient_trainer.laboratory.rehearsal.laboratory import rehearsal

    clock = FastClock(speed)
    with rehearsal(loaded, clock, seed) as there:
        yield Job(there.loaded, output, clock, speed, True, there.environment)


def _run(job: Job, resume: bool) -> int:
    from ambient_trainer.laboratory import collect as work

    console = printer()
    with _stopping() as asked, _eyes(console, job) as eyes:
        watching = work.Watching(eyes, lambda: _why(asked), lambda: asked.count(signal.SIGINT) > 1)
        collected = work.resume(job, watching) if resume else work.collect(job, watching)
    return _tell(console, job, collected)


@contextlib.contextmanager
def _stopping() -> Iterator[list[int]]:
    """The signals that came, in place of what they do else."""
    asked: list[int] = []
    # one that is ignored stays so: nohup means it
    wanted = [each for each in _SIGNALS if signal.getsignal(each) is not signal.SIG_IGN]
    before = {each: signal.signal(each, lambda number, _: asked.append(number)) for each in wanted}
    try:
        yield asked
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _why(asked: list[int]) -> str | None:
    return f"stopped by {signal.Signals(asked[0]).name}" if asked else None


@contextlib.contextmanager
def _eyes(console: Console, job: Job) -> Iterator[Eyes]:
    from ambient_trainer.laboratory.view import LiveEyes, PlainEyes

    if not console.is_terminal:
        yield PlainEyes(console)
        return
    simulated = f", simulated at {job.speed:g} times real time" if job.simulated else ""
    with LiveEyes(console, f"{job.loaded.name}{simulated}") as eyes:
        yield eyes


def _tell(console: Console, job: Job, collected: Collected) -> int:
    from ambient_trainer.laboratory import summary
    from ambient_trainer.laboratory.conductor import Ending

    outcome = collected.outcome
    campaign = job.loaded.campaign
    if collected.trace is not None:
        console.print(for_terminal(summary.column_table(collected.trace)))
        settling = summary.settling_table(collected.record, campaign)
        console.print(for_terminal(settling))
    for line in summary.happenings(collected.record):
        console.print(line, markup=False, soft_wrap=True)
    simulated = " All of it is simulated." if job.simulated else ""
    console.print(f"{summary.headline(collected, job.output)}{simulated}", markup=False, soft_wrap=True)
    safe_degC = campaign.laboratory.safety.set_point_degC
    if not outcome.safe:
        left = "" if job.simulated else " (for an hour, a process left behind goes on telling it)"
        problem = f"the chamber has NOT confirmed its safe set point, {safe_degC:g} degC: see to it{left}"
        click.echo(f"ambient-trainer: {problem}", err=True)
    elif outcome.alarm is not None:
        click.echo(f"ambient-trainer: the chamber is stopped, after its alarm: {outcome.alarm}", err=True)
    if outcome.ending is not Ending.FINISHED:
        where = f"the chamber holds {safe_degC:g} degC; " if outcome.safe and outcome.alarm is None else ""
        click.echo(f"ambient-trainer: {outcome.why}; {where}--resume goes on with it", err=True)
    return 0 if outcome.ending is Ending.FINISHED and outcome.alarm is None and outcome.safe else 1


def _print_schedule(loaded: Loaded) -> None:
    from ambient_trainer.laboratory.schedule import clock_text, expected, schedule_table

    campaign = loaded.campaign
    console = printer()
    console.print(f"{loaded.name}: {campaign.about}", markup=False)
    console.print(for_terminal(schedule_table(campaign)))
    steps = expected(campaign)
    count = len(campaign.before)
    recorded = sum(each.length_s for each in steps[count:])
    whole = steps[-1].begins_s + steps[-1].length_s
    rows = round(recorded / campaign.period_s)
    console.print(f"{clock_text(whole)} in all, {clock_text(recorded)} of it recorded: {rows:,} rows.")
    console.print(f"From {', '.join(loaded.files)}", markup=False, soft_wrap=True)
    for name, link in campaign.laboratory.instruments:
        if link is not None and not os.path.exists(link.port):
            console.print(f"{name}: {link.port} is not there now.", markup=False)
