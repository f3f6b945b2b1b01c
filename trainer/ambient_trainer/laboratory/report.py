"""The report of a run: what each column holds and lacks, how long the air took to each set point, what happened."""

from __future__ import annotations

import itertools
from collections import Counter

from ambient_trainer.laboratory.campaign import Campaign
from ambient_trainer.laboratory.collect import Collected, Job, laboratory_path
from ambient_trainer.laboratory.journal import Record
from ambient_trainer.laboratory.messages import MULTIPLEXER, Failure, Note
from ambient_trainer.laboratory.run import Outcome
from ambient_trainer.laboratory.schedule import clock_text
from ambient_trainer.laboratory.trace_rows import Rows
from ambient_trainer.report import Finding, Report, Section, Table

_AT_SET_POINT_K = 2.0
"""The air is called at its set point this near to it; a chamber's swing is about 1 K."""
_MOST_SHOWN = 20


def column_table(rows: Rows) -> Table:
    """Per column of a trace: samples, gaps, and the range of what stands there."""
    lines = []
    for index, name in enumerate(rows.columns):
        values = [values[index] for _, values in rows.rows]
        known = [value for value in values if value is not None]
        gaps = [len(list(run)) for missing, run in itertools.groupby(values, lambda value: value is None) if missing]
        extent = [min(known), sum(known) / len(known), max(known)] if known else []
        texts = [f"{each:.3f}" for each in extent] or ["-"] * 3
        lines.append((name, f"{len(known):,}", f"{len(gaps):,}", f"{max(gaps, default=0):,}", *texts))
    caption = f"Of {len(rows.rows):,} rows. Longest: the most rows in a row without a value."
    return Table(caption, ("column", "samples", "gaps", "longest", "min", "mean", "max"), tuple(lines), labels=1)


def settling_table(record: Record, campaign: Campaign) -> Table:
    """Per step with another set point than the one before: how long the air took to it."""
    begins: dict[int, float] = {}
    for each in record.steps:
        begins.setdefault(each.step, each.at_s - each.elapsed_s)
    mean_degC = campaign.laboratory.ambient.mean_degC
    ambient = [(each.at_s, mean_degC(each.values)) for each in record.samples if each.source == MULTIPLEXER]
    lines = []
    program = campaign.program
    for index, step in enumerate(program):
        if index not in begins or (index and program[index - 1].chamber_degC == step.chamber_degC):
            continue
        begin_s, end_s = begins[index], begins.get(index + 1, float("inf"))
        there_s = (
            at_s
            for at_s, value in ambient
            if value is not None and begin_s <= at_s < end_s and abs(value - step.chamber_degC) <= _AT_SET_POINT_K
        )
        first_s = next(there_s, None)
        took = "never in its time" if first_s is None else clock_text(first_s - begin_s)
        lines.append((campaign.step_name(index), f"{step.chamber_degC:g}", took))
    caption = f"Until the ambient was first within {_AT_SET_POINT_K:g} K of the set point (h:mm:ss)."
    return Table(caption, ("step", "set degC", "air there after"), tuple(lines), labels=1)


def events(record: Record) -> list[str]:
    """The notes of the run, with their times since the program began; the most frequent failures last."""
    notes = [(entry.at_s, entry.text) for entry in record.entries if isinstance(entry, Note)]
    lines = [f"{clock_text(at_s)}  {text}" for at_s, text in notes[:_MOST_SHOWN]]
    if len(notes) > _MOST_SHOWN:
        lines.append(f"and {len(notes) - _MOST_SHOWN} more")
    failures = Counter(entry.source for entry in record.entries if isinstance(entry, Failure))
    lines += [f"{source}: {count} failure{'s' * (count > 1)}" for source, count in failures.most_common()]
    return lines


def report_of(collected: Collected, job: Job) -> Report:
    """How much a run left and where, with its tables and events."""
    record, trace = collected.record, collected.trace
    after = f"after {clock_text(record.last_s)}"
    title = f"No trace, {after}: the recording had not begun."
    tables: list[Table] = []
    if trace is not None:
        beside = laboratory_path(job.output)
        title = f"{len(trace.rows):,} rows in {job.output}, the instruments' own readings in {beside}, {after}."
        tables = [column_table(trace), settling_table(record, job.loaded.campaign)]
    simulated = " All of it is simulated." if job.simulated else ""
    found = [Finding(text) for text in events(record)]
    return Report(f"{title}{simulated}", [], [Section("", [*tables, *found])], {}, "Collection")


def problems_of(outcome: Outcome, job: Job) -> list[str]:
    """What is not as it should be at the end of a run, and what to do about it."""
    safe_degC = job.loaded.campaign.laboratory.safety.set_point_degC
    problems = []
    if not outcome.safe:
        left = "" if job.simulated else " (for an hour, a process left behind goes on sending it)"
        problems.append(f"the chamber has NOT confirmed its safe set point, {safe_degC:g} degC: see to it{left}")
    elif outcome.alarm is not None:
        problems.append(f"the chamber is stopped, after its alarm: {outcome.alarm}")
    if not outcome.finished:
        where = f"the chamber holds {safe_degC:g} degC; " if outcome.safe and outcome.alarm is None else ""
        problems.append(f"{outcome.why}; {where}--resume goes on with it")
    return problems
