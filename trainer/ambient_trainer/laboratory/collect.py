"""A campaign from its file to its trace: a new run, or one that goes on where it was stopped.

The journal beside the trace holds the run until the trace is written whole. What was read before the stop stays as it
is; the time in between is a gap, and the program goes on with the step, and the time in the step, where it was.

A trace has one row a period, in which each cell is what was read in that period, or empty. A sample belongs to the
period in which the middle of its asking and answering lies, and to none where that leaves its time unknown by more than
a period. Nothing is repeated or interpolated.
"""

import contextlib
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import wait
from datetime import datetime, timezone
from functools import partial
from statistics import median_high
from typing import NamedTuple

import pandas as pd

from ambient_model.faults import Refused, refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Trace, save_trace
from ambient_trainer.laboratory import messages
from ambient_trainer.laboratory.campaign import Campaign, Laboratory, LoadedCampaign
from ambient_trainer.laboratory.journal import Head, Journal, JournalRecord, read_journal
from ambient_trainer.laboratory.messages import DEVICE, Clock, Note, Sample, StepBegan, in_background
from ambient_trainer.laboratory.program import Program
from ambient_trainer.laboratory.run import CampaignRun, Ending, Outcome, Supervision, equipment_of, identify
from ambient_trainer.laboratory.watchdog import Watchdog
from ambient_trainer.laboratory.workers import Target

_POLL_S = 0.1


class Job(NamedTuple):
    """A campaign to run into a trace; ``environment`` is added to that of the device's shells."""

    loaded: LoadedCampaign
    output: str
    speed: float = 1.0
    simulated: bool = False
    environment: Mapping[str, str] | None = None


class Collected(NamedTuple):
    """What came of a run; ``trace`` is None where the recording had not begun, or it could not be written."""

    outcome: Outcome
    record: JournalRecord
    trace: pd.DataFrame | None


def journal_path(output: str) -> str:
    """Where the journal of the trace at ``output`` is."""
    return f"{output}.part"


def laboratory_path(output: str) -> str:
    """Where the instruments' own readings go."""
    ending = next((each for each in (".csv.gz", ".csv") if output.endswith(each)), "")
    return f"{output.removesuffix(ending)}.laboratory{ending or '.csv'}"


def collect(job: Job, supervision: Supervision) -> Collected:
    """Run the campaign from its beginning; raises :class:`Refused` before anything moves."""
    head = partial(Head.now, job.loaded.name, job.loaded.sha256, job.speed, job.simulated)
    if os.path.exists(journal_path(job.output)):
        Journal(journal_path(job.output), head())  # is refused, with what to do about it
    clock = Clock(job.speed)
    equipment = equipment_of(job.loaded, clock, job.environment)
    try:
        found = in_background(identify, equipment, job.loaded)
        while not wait([found], _POLL_S).done:
            if why := supervision.stopping():
                raise refuse("the laboratory", "", why, "nothing was moved")
        entries = found.result()
    except BaseException:
        for driver, _ in equipment.values():
            driver.close()
        raise
    clock.set(0.0)
    journal = Journal(journal_path(job.output), head())
    for entry in entries:
        journal.add(entry)
        if isinstance(entry, Note):
            supervision.show(*entry)
    campaign = job.loaded.campaign
    return _run(job, CampaignRun(campaign, equipment, clock, journal, Program(campaign.program, 0.0), supervision))


def resume(job: Job, supervision: Supervision) -> Collected:
    """Go on with the run whose journal is there; raises :class:`Refused` where it is another campaign's."""
    record, campaign = read_journal(journal_path(job.output)), job.loaded.campaign
    head, last_s, left = record.head, record.last_s, record.left
    if head.sha256 != job.loaded.sha256:
        problem = f"holds a run of campaign {head.campaign!r} as it was with SHA-256 {head.sha256[:12]}"
        hint = f"{job.loaded.path} is another, or was changed since: give the one that it began with"
        raise refuse(journal_path(job.output), "", problem, hint)
    if (head.simulated, head.speed) != (job.simulated, job.speed):
        began = f"--simulate --speed {head.speed:g}" if head.simulated else "real instruments"
        raise refuse(journal_path(job.output), "", f"holds a run that began with {began}", "resume it the same way")
    if left.step >= len(campaign.program):  # only the trace is missing
        return _written(job, Outcome(Ending.FINISHED, "finished", None, True))
    journal = Journal(journal_path(job.output))
    # the calendar may have been set back in between: time goes on all the same
    now_s = max(head.now_s(), last_s + campaign.period_s)
    clock = Clock(job.speed)
    clock.set(now_s)
    journal.add(messages.LoadState(last_s, None))
    journal.add(Note(now_s, f"resumed after {now_s - last_s:.0f} s"))
    program = Program(campaign.program, now_s, left.step, left.elapsed_s)
    equipment = equipment_of(job.loaded, clock, job.environment)
    return _run(job, CampaignRun(campaign, equipment, clock, journal, program, supervision))


def _run(job: Job, run: CampaignRun) -> Collected:
    campaign = job.loaded.campaign
    chamber, safe_degC = campaign.laboratory.instruments.chamber, campaign.laboratory.safety.set_point_degC
    with contextlib.ExitStack() as stack:
        stack.callback(run.journal.close)
        watchdog = None
        # a simulated chamber ends with this process
        if chamber is not None and safe_degC is not None and not job.simulated:
            log_path = os.path.abspath(f"{job.output}.safety.log")
            safe = Target(safe_degC, campaign.no_gradient_K_min, urgent=True)
            watchdog = stack.enter_context(Watchdog(chamber, safe, log_path))
        outcome = run.conduct(watchdog)
        if watchdog is not None and not outcome.safe:
            watchdog.take_over()
    return _written(job, outcome)


def _written(job: Job, outcome: Outcome) -> Collected:
    """The trace, whole, of what there is; a journal that has come to its end is removed."""
    record, campaign = read_journal(journal_path(job.output)), job.loaded.campaign
    over, trace = outcome.finished, None
    if over and record.deviations:
        outcome = outcome._replace(ending=Ending.DEVIATED, why="; ".join(record.deviations))
    if (grid := grid_of(record, campaign)) is not None:
        notes, trace = _notes(job, record, outcome), trace_rows(record, campaign, grid)
        beside = laboratory_rows(record, campaign, grid)
        try:
            for path, table in ((job.output, trace), (laboratory_path(job.output), beside)):
                columns = {str(name): values.to_numpy() for name, values in table.items()}
                save_trace(path, Trace(path, table.index.to_numpy(), columns, notes))
        except Refused as refused:  # that the chamber is not safe has to be said all the same
            why = f"{outcome.why}; {path}: {refused.faults[0].problem}"
            over, trace, outcome = False, None, outcome._replace(ending=Ending.FAILED, why=why)
    if over:
        os.unlink(journal_path(job.output))
    return Collected(outcome, record, trace)


def _notes(job: Job, record: JournalRecord, outcome: Outcome) -> dict[str, str]:
    """What a reader of the trace has to know, with how long answers took, and how far the device's clock was ahead."""
    loaded = job.loaded
    began = datetime.fromtimestamp(record.head.began_unix_s, timezone.utc)
    notes = {
        "campaign": loaded.name,
        "campaign_sha256": loaded.sha256,
        "simulated": "yes" if job.simulated else "no",
        "program_began": began.isoformat(timespec="seconds"),
        "complete": "yes" if outcome.finished else f"no: {outcome.why}",
    }
    notes.update({entry.source: entry.text for entry in record.of(messages.Identity)})
    probes = [name for name in loaded.campaign.laboratory.ambient.probes if name in loaded.offsets]
    notes["offsets"] = "; ".join(f"{name} {loaded.offsets[name]}" for name in probes) or "none"
    took = [(each.answered_s - each.asked_s, each) for each in record.of(Sample)]
    for source in dict.fromkeys(each.source for _, each in took):
        delays_s = [delay_s for delay_s, each in took if each.source == source]
        notes[f"{source}_delay_s"] = f"median {median_high(delays_s):.4f}, worst {max(delays_s):.4f}"
    clocks = [(delay_s, each.values.get(messages.CLOCK_OFFSET)) for delay_s, each in took if each.source == DEVICE]
    if offsets := [(delay_s, offset_s) for delay_s, offset_s in clocks if offset_s is not None]:
        delay_s, offset_s = min(offsets)  # the quickest answer leaves the least doubt
        drift_s = offsets[-1][1] - offsets[0][1]
        notes["device_clock"] = f"uptime {offset_s} s ahead (+-{0.5 * delay_s:.4f} s), {drift_s:+.4f} s more at the end"
    return notes


_ROUNDING_S = 1e-6


class Grid(NamedTuple):
    """Rows at multiples of ``period_s`` after ``zero_s`` of the run's time."""

    zero_s: float
    period_s: float

    def row_at(self, at_s: float) -> int:
        """The row of what happened at ``at_s``."""
        return math.floor((at_s - self.zero_s + _ROUNDING_S) / self.period_s)

    def frame(self, cells: dict[int, dict[str, float | None]], columns: Sequence[str]) -> pd.DataFrame:
        """The rows' cells as a table over their times; NaN where there is nothing."""
        table = pd.DataFrame.from_dict(cells, orient="index", columns=pd.Index(columns), dtype=float).sort_index()
        return table.set_axis((table.index.to_numpy(dtype=float) * self.period_s).round(6), axis="index")


def grid_of(record: JournalRecord, campaign: Campaign) -> Grid | None:
    """The rows' times, whose zero is the beginning of the recording; None where there was none."""
    began = next((each for each in record.of(StepBegan) if each.step >= len(campaign.before)), None)
    if began is None:
        return None
    # on the samplers' own schedule, so that a sample which comes a little late does not change its row
    first = math.floor((began.at_s - began.elapsed_s) / campaign.period_s + _ROUNDING_S)
    return Grid(first * campaign.period_s, campaign.period_s)


def trace_rows(record: JournalRecord, campaign: Campaign, grid: Grid) -> pd.DataFrame:
    """The trace over its time in s: the device's columns, the ambient, the signals."""
    laboratory = campaign.laboratory
    over = [each.at_s for each in record.of(StepBegan) if each.step == len(campaign.program)]
    count = max(grid.row_at(over[-1]) if over else grid.row_at(record.left.at_s) + 1, 0)
    cells: dict[int, dict[str, float | None]] = {index: {} for index in range(count)}
    for sample in record.of(Sample):
        row = cells.get(grid.row_at(sample.at_s))
        if row is None or 0.5 * (sample.answered_s - sample.asked_s) > grid.period_s:
            continue
        if sample.source == DEVICE:
            row.update({name: sample.values.get(name) for name in laboratory.device.columns})
        elif sample.source == laboratory.reference:
            row[REFERENCE] = laboratory.ambient.mean_degC(sample.values)
    changes = record.of(messages.LoadState)
    begins = [max(grid.row_at(each.at_s), 0) for each in changes]
    for change, begin, end in zip(changes, begins, [*begins[1:], count]):
        # unknown until the device's load is known
        signals = {} if change.actions is None else signals_while(laboratory, change.actions)
        for index in range(begin, min(end, count)):
            cells[index].update(signals)
    return grid.frame(cells, campaign.columns)


def laboratory_rows(record: JournalRecord, campaign: Campaign, grid: Grid) -> pd.DataFrame:
    """The instruments' own readings, also before the recording; only rows that hold any."""
    device = campaign.laboratory.device.columns
    cells: dict[int, dict[str, float | None]] = {}
    for sample in record.of(Sample):
        row = cells.setdefault(grid.row_at(sample.at_s), {})
        row.update({name: value for name, value in sample.values.items() if name not in device})
        row[f"{sample.source}_delay_s"] = round(sample.answered_s - sample.asked_s, 4)
    return grid.frame(cells, sorted({name for row in cells.values() for name in row}))


def signals_while(laboratory: Laboratory, actions: Sequence[str]) -> dict[str, float]:
    """The signals while ``actions`` last: where several have one, the largest."""
    active = [item for action in actions for item in laboratory.actions[action].signals.items()]
    return {**laboratory.signals, **dict(sorted(active, key=lambda item: item[1]))}
