"""How long a program takes, estimated: ramps at the chamber's usual rates, and the settling that is asked for."""

from __future__ import annotations

import os
from typing import NamedTuple

from ambient_trainer.laboratory.campaign import Campaign, LoadedCampaign
from ambient_trainer.report import Block, Finding, Report, Table
from ambient_trainer.simulator.scenario import Settle

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
    chamber, air_degC = campaign.laboratory.instruments.chamber, campaign.laboratory.safety.set_point_degC
    found: list[Expected] = []
    begins_s = 0.0
    for step in campaign.program:
        rate_K_min = chamber.heating_K_min if step.chamber_degC > air_degC else chamber.cooling_K_min
        if step.gradient_K_min is not None:
            rate_K_min = min(rate_K_min, step.gradient_K_min)
        ramp_s = 60.0 * abs(step.chamber_degC - air_degC) / rate_K_min
        length_s = 60.0 * (step.duration_min or 0.0)
        if step.settle is not None:
            settled_s = ramp_s + 60.0 * step.settle.for_min
            length_s = max(length_s, min(settled_s, 60.0 * step.settle.at_most_min))
        found.append(Expected(begins_s, length_s, ramp_s))
        begins_s += length_s
        # a ramp that its step does not leave enough time for goes on in the next
        done = min(1.0, length_s / ramp_s) if ramp_s else 1.0
        air_degC += done * (step.chamber_degC - air_degC)
    return found


def schedule_table(campaign: Campaign) -> Table:
    """The program, a step a row."""
    rows = tuple(
        (
            campaign.step_name(index),
            clock_text(each.begins_s),
            clock_text(each.length_s),
            f"{step.chamber_degC:g}",
            clock_text(each.ramp_s) if each.ramp_s else "-",
            _settle_text(step.settle),
            ", ".join(step.load) or "-",
        )
        for index, (step, each) in enumerate(zip(campaign.program, expected(campaign)))
    )
    columns = ("step", "begins", "takes", "degC", "air there", "steady", "device does")
    return Table(_CAPTION, columns, rows, labels=1)


def report_of(loaded: LoadedCampaign) -> Report:
    """The schedule of a campaign, its length, and the ports that are not there now."""
    campaign = loaded.campaign
    steps = expected(campaign)
    recorded_s = sum(each.length_s for each in steps[len(campaign.before) :])
    whole_s = steps[-1].begins_s + steps[-1].length_s
    rows = round(recorded_s / campaign.period_s)
    missing = [
        Finding(f"{name}: {settings.port} is not there now.")
        for name, settings in campaign.laboratory.instruments
        if settings is not None and not os.path.exists(settings.port)
    ]
    blocks: list[Block] = [
        schedule_table(campaign),
        Finding(f"{clock_text(whole_s)} in all, {clock_text(recorded_s)} of it recorded: {rows:,} rows."),
        Finding(f"From {', '.join(loaded.files)}"),
        *missing,
    ]
    return Report(f"{loaded.name}: {campaign.about}", blocks, [], {}, "Schedule")


def _settle_text(settle: Settle | None) -> str:
    return "-" if settle is None else f"{settle.for_min:g} min in {settle.within_K:g} K"


def clock_text(duration_s: float) -> str:
    """A duration as h:mm:ss."""
    whole = round(duration_s)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
