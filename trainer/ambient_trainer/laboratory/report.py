"""The report of a run: what each column holds and lacks, how long the air took to each set point, what happened.

The report before a run is its schedule, estimated: ramps at the chamber's usual rates, and the settling asked for.
"""

import math
from collections import Counter
from typing import NamedTuple

import pandas as pd

from ambient_trainer.laboratory.campaign import Campaign, LoadedCampaign
from ambient_trainer.laboratory.collect import Collected, Job, laboratory_path
from ambient_trainer.laboratory.journal import JournalRecord
from ambient_trainer.laboratory.messages import Failure, Note, Sample, StepBegan
from ambient_trainer.laboratory.run import Ending, Outcome
from ambient_trainer.laboratory.serial_line import is_missing
from ambient_trainer.report import Block, Finding, Report, Section, Table
from ambient_trainer.report.words import clock, column_table

_CAPTION = (
    "Times in h:mm:ss; air there after: estimated from the chamber's usual rates, from its safe set point on. A step "
    "that waits for a steady state may take longer. Before the recording all is logged, but not into the trace."
)


class Expected(NamedTuple):
    """One step: when it begins in the program, how long it takes, and until when the air is about at the set point."""

    begins_s: float
    length_s: float
    ramp_s: float


def expected(campaign: Campaign) -> list[Expected]:
    """Every step of the program, which finds the chamber at its safe set point."""
    chamber, air_degC = campaign.laboratory.instruments.chamber, campaign.laboratory.safety.set_point_degC or 0.0
    found: list[Expected] = []
    begins_s = 0.0
    for step in campaign.program:
        to_degC, rate_K_min = air_degC if step.chamber_degC is None else step.chamber_degC, math.inf
        if chamber is not None:
            rate_K_min = chamber.heating_K_min if to_degC > air_degC else chamber.cooling_K_min
        ramp_s = 60.0 * abs(to_degC - air_degC) / min(rate_K_min, step.gradient_K_min or math.inf)
        length_s = 60.0 * (step.duration_min or 0.0)
        if step.settle is not None:
            settled_s = ramp_s + 60.0 * step.settle.for_min
            length_s = max(length_s, min(settled_s, 60.0 * step.settle.at_most_min))
        found.append(Expected(begins_s, length_s, ramp_s))
        begins_s += length_s
        # a ramp that its step does not leave enough time for goes on in the next
        done = min(1.0, length_s / ramp_s) if ramp_s else 1.0
        air_degC += done * (to_degC - air_degC)
    return found


def schedule_report(loaded: LoadedCampaign) -> Report:
    """The schedule of a campaign, its length, and the ports that are not there now."""
    campaign = loaded.campaign
    steps = expected(campaign)
    lines = [
        (
            campaign.step_name(index),
            clock(each.begins_s),
            clock(each.length_s),
            degrees_text(step.chamber_degC),
            clock(each.ramp_s) if each.ramp_s else "-",
            f"{step.settle.for_min:g} min in {step.settle.within_K:g} K" if step.settle else "-",
            ", ".join(step.load) or "-",
        )
        for index, (step, each) in enumerate(zip(campaign.program, steps))
    ]
    columns = ("step", "begins", "takes", "degC", "air there", "steady", "device does")
    recorded_s = sum(each.length_s for each in steps[len(campaign.before) :])
    whole_s = steps[-1].begins_s + steps[-1].length_s
    rows = round(recorded_s / campaign.period_s)
    there = campaign.laboratory.instruments.named
    found = [f"{clock(whole_s)} in all, {clock(recorded_s)} of it recorded: {rows:,} rows."]
    found.append(f"From {', '.join(loaded.files)}")
    found += [f"{name}: {each.port} is not there now." for name, each in there.items() if is_missing(each.port)]
    blocks: list[Block] = [Table(_CAPTION, columns, lines, labels=1), *map(Finding, found)]
    return Report(f"{loaded.name}: {campaign.about}", blocks, [], {}, "Schedule")


def degrees_text(temp_degC: float | None) -> str:
    """A temperature, or a dash where there is none."""
    return "-" if temp_degC is None else f"{temp_degC:g}"


_AT_SET_POINT_K = 2.0  # the air is called at its set point this near to it; a chamber's swing is about 1 K
_MOST_SHOWN = 20


def settling_table(record: JournalRecord, campaign: Campaign) -> Table:
    """Per step with another set point than the one before: how long the air took to it."""
    begins: dict[int, float] = {}
    for each in record.of(StepBegan):
        begins.setdefault(each.step, each.at_s - each.elapsed_s)
    laboratory, program = campaign.laboratory, campaign.program
    scans = [each for each in record.of(Sample) if each.source == laboratory.reference]
    means_degC = [laboratory.ambient.mean_degC(each.values) for each in scans]
    ambient = pd.Series(means_degC, [each.at_s for each in scans], float)
    lines = []
    for index, (step, before) in enumerate(zip(program, (None, *program))):
        set_degC = step.chamber_degC
        if set_degC is None or (before and set_degC == before.chamber_degC) or index not in begins:
            continue
        within = ambient[(ambient - set_degC).abs() <= _AT_SET_POINT_K].loc[begins[index] : begins.get(index + 1)]
        took = clock(within.index[0] - begins[index]) if len(within) else "never in its time"
        lines.append((campaign.step_name(index), f"{set_degC:g}", took))
    caption = f"Until the ambient was first within {_AT_SET_POINT_K:g} K of the set point (h:mm:ss)."
    return Table(caption, ("step", "set degC", "air there after"), tuple(lines), labels=1)


def events(record: JournalRecord) -> list[str]:
    """The notes of the run, with their times since the program began; the most frequent failures last."""
    notes = [(entry.at_s, entry.text) for entry in record.of(Note)]
    lines = [f"{clock(at_s)}  {text}" for at_s, text in notes[:_MOST_SHOWN]]
    if len(notes) > _MOST_SHOWN:
        lines.append(f"and {len(notes) - _MOST_SHOWN} more")
    failures = Counter(entry.source for entry in record.of(Failure))
    lines += [f"{source}: {count} failure{'s' * (count > 1)}" for source, count in failures.most_common()]
    return lines


def collection_report(collected: Collected, job: Job) -> Report:
    """How much a run left and where, with its tables and events."""
    record, trace = collected.record, collected.trace
    after = f"after {clock(record.last_s)}"
    title = f"No trace, {after}: the recording had not begun, or cannot be written."
    tables: list[Table] = []
    if trace is not None:
        beside = laboratory_path(job.output)
        title = f"{len(trace):,} rows in {job.output}, the instruments' own readings in {beside}, {after}."
        tables = [column_table(trace), settling_table(record, job.loaded.campaign)]
    simulated = " All of it is simulated." if job.simulated else ""
    found = [Finding(text) for text in events(record)]
    return Report(f"{title}{simulated}", [], [Section("", [*tables, *found])], {}, "Collection")


def problems_of(outcome: Outcome, job: Job) -> list[str]:
    """What is not as it should be at the end of a run, and what to do about it."""
    safe_degC = job.loaded.campaign.laboratory.safety.set_point_degC
    problems = []
    if safe_degC is not None and not outcome.safe:
        left = "" if job.simulated else " (for an hour, a process left behind goes on sending it)"
        problems.append(f"the chamber has NOT confirmed its safe set point, {safe_degC:g} degC: see to it{left}")
    elif safe_degC is not None and outcome.alarm is not None:
        problems.append(f"the chamber is stopped, after its alarm: {outcome.alarm}")
    if not outcome.finished:
        held = safe_degC is not None and outcome.safe and outcome.alarm is None
        where, again = f"the chamber holds {safe_degC:g} degC; " if held else "", "--resume goes on with it"
        if outcome.ending is Ending.DEVIATED:
            again = "the trace is whole, and its note says so"
        problems.append(f"{outcome.why}; {where}{again}")
    return problems
