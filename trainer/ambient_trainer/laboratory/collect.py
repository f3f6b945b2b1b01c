"""A campaign from its file to its trace: a new run, or one that goes on where it was stopped.

The journal beside the trace holds the run until the trace is written whole. What was said before the stop stays as it
is; the time in between is a gap, and the program goes on with the step, and the time in the step, where it was.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from typing import NamedTuple

from ambient_model.faults import refuse
from ambient_model.trace import write_trace
from ambient_trainer.laboratory.bench import CLOCK_OFFSET, Bench, bench_of, identities
from ambient_trainer.laboratory.campaign import Loaded
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.conductor import Conductor, Ending, Eyes, Outcome
from ambient_trainer.laboratory.guard import Guard
from ambient_trainer.laboratory.journal import (
    Head,
    Identity,
    Journal,
    Note,
    Record,
    read_journal,
)
from ambient_trainer.laboratory.messages import DEVICE, Doing, Sample, Timebase
from ambient_trainer.laboratory.program import Program
from ambient_trainer.laboratory.rows import Rows, grid_of, laboratory_rows, trace_rows


class Job(NamedTuple):
    """What is to be run, and how."""

    loaded: Loaded
    output: str
    clock: Clock
    speed: float = 1.0
    """Of the clock."""
    simulated: bool = False
    environment: Mapping[str, str] | None = None
    """Added to that of the device's shells."""


class Watching(NamedTuple):
    """Who looks at a run, and may end it."""

    eyes: Eyes
    stopping: Callable[[], str | None]
    giving_up: Callable[[], bool]


class Collected(NamedTuple):
    """What came of a run."""

    outcome: Outcome
    record: Record
    trace: Rows | None
    """None where the recording had not begun."""
    laboratory_path: str


def journal_path(output: str) -> str:
    """Where the journal of the trace at ``output`` is."""
    return f"{output}.part"


def laboratory_path(output: str) -> str:
    """Where what the instruments said themselves goes."""
    for ending in (".csv.gz", ".csv"):
        if output.endswith(ending):
            return f"{output.removesuffix(ending)}.laboratory{ending}"
    return f"{output}.laboratory.csv"


def collect(job: Job, watching: Watching) -> Collected:
    """Run the campaign from its beginning; raises :class:`Refused` before anything moves."""
    if os.path.exists(journal_path(job.output)):
        Journal(journal_path(job.output), _head(job))  # says what to do about it
    bench = bench_of(job.loaded, job.clock, job.environment)
    try:
        found = identities(bench)
    except BaseException:
        bench.close()
        raise
    timebase = Timebase(job.clock, job.clock.now_s())
    journal = Journal(journal_path(job.output), _head(job))
    for identity in found:
        journal.add(Identity(*identity))
    return _run(job, bench, journal, timebase, Program(job.loaded.campaign.program, 0.0), watching)


def resume(job: Job, watching: Watching) -> Collected:
    """Go on with the run whose journal is there; raises :class:`Refused` where it is another campaign's."""
    path = journal_path(job.output)
    record = read_journal(path)
    _check_same(job, record, path)
    campaign = job.loaded.campaign
    last_s, left = record.last_s, record.left
    if left.step >= len(campaign.program):  # all was done but the trace
        return _written(job, Outcome(Ending.FINISHED, "finished", None, True))
    journal = Journal(path)
    # the calendar may have been set back in between: time goes on all the same
    now_s = max((time.time() - record.head.began_unix_s) * record.head.speed, last_s + campaign.period_s)
    timebase = Timebase(job.clock, job.clock.now_s() - now_s)
    journal.add(Doing(last_s, None))
    journal.add(Note(now_s, f"resumed after {now_s - last_s:.0f} s"))
    program = Program(campaign.program, now_s, left.step, left.elapsed_s)
    bench = bench_of(job.loaded, job.clock, job.environment)
    return _run(job, bench, journal, timebase, program, watching)


def _run(
    job: Job, bench: Bench, journal: Journal, timebase: Timebase, program: Program, watching: Watching
) -> Collected:
    laboratory = job.loaded.campaign.laboratory
    link = laboratory.instruments.chamber
    guard = Guard(link.port, laboratory.safety.set_point_degC, link.pause_s, link.timeout_s)
    with contextlib.ExitStack() as stack:
        stack.callback(journal.close)
        if not job.simulated:  # a simulated chamber ends with this process
            stack.enter_context(guard)
        outcome = Conductor(bench, timebase, journal, program, *watching).conduct()
        if not outcome.safe:
            guard.take_over()
    return _written(job, outcome)


def _written(job: Job, outcome: Outcome) -> Collected:
    """The trace, whole, of what there is; a journal that has come to its end goes."""
    record = read_journal(journal_path(job.output))
    campaign = job.loaded.campaign
    grid = grid_of(record, campaign)
    beside = laboratory_path(job.output)
    trace = None
    if grid is not None:
        notes = _notes(job, record, outcome)
        trace = trace_rows(record, campaign, grid)
        write_trace(job.output, trace.columns, trace.rows, notes)
        further = laboratory_rows(record, campaign, grid)
        write_trace(beside, further.columns, further.rows, notes)
    if outcome.ending is Ending.FINISHED:
        os.unlink(journal_path(job.output))
    return Collected(outcome, record, trace, beside)


def _head(job: Job) -> Head:
    return Head(job.loaded.name, job.loaded.sha256, time.time(), job.speed, job.simulated)


def _check_same(job: Job, record: Record, path: str) -> None:
    if record.head.sha256 != job.loaded.sha256:
        problem = f"holds a run of campaign {record.head.campaign!r} as it was with SHA-256 {record.head.sha256[:12]}"
        mend = f"{job.loaded.path} is another, or was changed since: give the one that it began with"
        raise refuse(path, "", problem, mend)
    if (record.head.simulated, record.head.speed) != (job.simulated, job.speed):
        began = f"--simulate --speed {record.head.speed:g}" if record.head.simulated else "real instruments"
        raise refuse(path, "", f"holds a run that began with {began}", "resume it the same way")


def _notes(job: Job, record: Record, outcome: Outcome) -> dict[str, str]:
    """What a reader of the trace has to know."""
    began = datetime.fromtimestamp(record.head.began_unix_s, timezone.utc)
    notes = {
        "campaign": job.loaded.name,
        "campaign_sha256": job.loaded.sha256,
        "simulated": "yes" if job.simulated else "no",
        "program_began": began.isoformat(timespec="seconds"),
        "complete": "yes" if outcome.ending is Ending.FINISHED else f"no: {outcome.why}",
    }
    notes.update({entry.source: entry.text for entry in record.entries if isinstance(entry, Identity)})
    probes = job.loaded.campaign.laboratory.ambient.probes
    offsets = [f"{name} {_points(job, name)}" for name in probes if name in job.loaded.offsets]
    notes["offsets"] = "; ".join(offsets) or "none"
    notes.update(_delays(record))
    return notes


def _points(job: Job, name: str) -> str:
    return ", ".join(f"{offset_K:+.3f} K at {reading:g} degC" for reading, offset_K in job.loaded.offsets[name].points)


def _delays(record: Record) -> dict[str, str]:
    """How long answers took, and what the device's clock was ahead of the run's."""
    samples = [entry for entry in record.entries if isinstance(entry, Sample)]
    notes = {}
    for source in dict.fromkeys(sample.source for sample in samples):
        delays = sorted(each.answered_s - each.asked_s for each in samples if each.source == source)
        notes[f"{source}_delay_s"] = f"median {delays[len(delays) // 2]:.4f}, worst {delays[-1]:.4f}"
    heard = [each for each in samples if each.source == DEVICE and each.values.get(CLOCK_OFFSET) is not None]
    if heard:
        # the quickest answers leave the least doubt
        best = min(heard, key=lambda each: each.answered_s - each.asked_s)
        doubt_s = 0.5 * (best.answered_s - best.asked_s)
        ends = [each.values[CLOCK_OFFSET] for each in (heard[0], heard[-1])]
        first, last = (value or 0.0 for value in ends)
        notes["device_clock"] = (
            f"uptime {best.values[CLOCK_OFFSET]} s ahead (+-{doubt_s:.4f} s), {last - first:+.4f} s more at the end"
        )
    return notes
