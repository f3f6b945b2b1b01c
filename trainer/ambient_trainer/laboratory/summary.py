"""What a run was, told at its end: what each column holds and lacks, how long the air took, what happened."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from ambient_trainer.laboratory.bench import ambient_degC
from ambient_trainer.laboratory.campaign import Campaign
from ambient_trainer.laboratory.collect import Collected
from ambient_trainer.laboratory.journal import Began, Note, Record, moment
from ambient_trainer.laboratory.messages import MULTIPLEXER, Sample, Trouble
from ambient_trainer.laboratory.rows import Rows
from ambient_trainer.laboratory.schedule import clock_text
from ambient_trainer.report.table import Table

_THERE_K = 2.0
"""From the set point, for the air to be called there; a chamber's swing is about 1 K."""
_MOST_SHOWN = 20


def column_table(rows: Rows) -> Table:
    """Per column of a trace: samples, gaps, and the range of what stands there."""
    lines = []
    for index, name in enumerate(rows.columns):
        values = [row[1][index] for row in rows.rows]
        known = [value for value in values if value is not None]
        gaps = list(_gaps(values))
        spread = [f"{each:.3f}" for each in (min(known), sum(known) / len(known), max(known))] if known else ["-"] * 3
        lines.append((name, f"{len(known):,}", f"{len(gaps):,}", f"{max(gaps, default=0):,}", *spread))
    caption = f"Of {len(rows.rows):,} rows. Longest: the most rows in a row without a value."
    return Table(caption, ("column", "samples", "gaps", "longest", "min", "mean", "max"), tuple(lines), labels=1)


def _gaps(values: list[float | None]) -> Iterator[int]:
    length = 0
    for value in [*values, 0.0]:
        if value is None:
            length += 1
        elif length:
            yield length
            length = 0


def settling_table(record: Record, campaign: Campaign) -> Table:
    """Per step with another set point than the one before: how long the air took to it."""
    begins: dict[int, float] = {}
    for each in record.entries:
        if isinstance(each, Began):
            begins.setdefault(each.step, each.at_s - each.elapsed_s)
    ambient = [
        (entry.at_s, ambient_degC(entry.values, campaign.laboratory.ambient))
        for entry in record.entries
        if isinstance(entry, Sample) and entry.source == MULTIPLEXER
    ]
    lines = []
    program = campaign.program
    for index, step in enumerate(program):
        if index not in begins or (index and program[index - 1].chamber_degC == step.chamber_degC):
            continue
        end_s = begins.get(index + 1, float("inf"))
        there = [
            at_s
            for at_s, value in ambient
            if value is not None and begins[index] <= at_s < end_s and abs(value - step.chamber_degC) <= _THERE_K
        ]
        took = clock_text(there[0] - begins[index]) if there else "never in its time"
        lines.append((_place(index, campaign), f"{step.chamber_degC:g}", took))
    caption = f"Until the ambient was first within {_THERE_K:g} K of the set point (h:mm:ss)."
    return Table(caption, ("step", "set degC", "air there after"), tuple(lines), labels=1)


def happenings(record: Record) -> list[str]:
    """What there is to tell of the night, with its time since the program began; the most frequent troubles last."""
    notes = [(entry.at_s, entry.text) for entry in record.entries if isinstance(entry, Note)]
    lines = [f"{clock_text(at_s)}  {text}" for at_s, text in notes[:_MOST_SHOWN]]
    if len(notes) > _MOST_SHOWN:
        lines.append(f"and {len(notes) - _MOST_SHOWN} more")
    troubles = Counter(entry.source for entry in record.entries if isinstance(entry, Trouble))
    lines += [f"{source}: {count} time{'s' * (count > 1)} in trouble" for source, count in troubles.most_common()]
    return lines


def length_text(record: Record) -> str:
    """How long the run was, stops and all."""
    return clock_text(max((moment(entry) for entry in record.entries), default=0.0))


def headline(collected: Collected, output: str) -> str:
    """What came of it, in a sentence."""
    after = f"after {length_text(collected.record)}"
    if collected.trace is None:
        return f"No trace, {after}: the recording had not begun."
    rows = len(collected.trace.rows)
    return f"{rows:,} rows in {output}, what the instruments said in {collected.laboratory_path}, {after}."


def _place(index: int, campaign: Campaign) -> str:
    before = len(campaign.before)
    return f"before {index + 1}" if index < before else str(index - before + 1)
