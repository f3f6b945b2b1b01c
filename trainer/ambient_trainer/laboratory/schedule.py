"""What a program will take, before it runs: ramps at the chamber's usual rates, and rest as long as steps ask for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ambient_trainer.laboratory.campaign import Campaign, ChamberLink
from ambient_trainer.report.table import Table
from ambient_trainer.simulator.scenario import Step


class Expected(NamedTuple):
    """One step as it should come."""

    begins_s: float
    """After the beginning of the program."""
    length_s: float
    ramp_s: float
    """Until the air is about at the set point."""


def expected(campaign: Campaign) -> list[Expected]:
    """Every step of the program, which finds the chamber at its safe set point."""
    laboratory = campaign.laboratory
    return _expected(campaign.program, laboratory.safety.set_point_degC, laboratory.instruments.chamber)


def _expected(steps: Sequence[Step], air_degC: float, chamber: ChamberLink) -> list[Expected]:
    found: list[Expected] = []
    begins_s = 0.0
    for step in steps:
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
    count = len(campaign.before)
    rows = []
    for index, (step, each) in enumerate(zip(campaign.program, expected(campaign))):
        rows.append(
            (
                f"before {index + 1}" if index < count else str(index - count + 1),
                clock_text(each.begins_s),
                clock_text(each.length_s),
                f"{step.chamber_degC:g}",
                clock_text(each.ramp_s) if each.ramp_s else "-",
                _rest(step),
                ", ".join(step.load) or "-",
            )
        )
    caption = (
        "Times in h:mm:ss; air there after: estimated from the chamber's usual rates, from its safe set point on. "
        "A step that waits for rest may take longer. Before the recording all is logged, but not into the trace."
    )
    columns = ("step", "begins", "takes", "degC", "air there", "rest", "device does")
    return Table(caption, columns, tuple(rows), labels=1)


def _rest(step: Step) -> str:
    settle = step.settle
    return "-" if settle is None else f"{settle.for_min:g} min in {settle.within_K:g} K"


def clock_text(duration_s: float) -> str:
    """A duration as h:mm:ss."""
    whole = round(duration_s)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
