"""The report of one tick, and its JSON object."""

from collections.abc import Sequence
from typing import NamedTuple

from ambient_model.model import Input
from ambient_model.tracking import Estimate


class Report(NamedTuple):
    """One tick."""

    model: str
    inputs: tuple[Input, ...]
    level_percent: int
    time_s: float
    """On the clock that counts from boot; in a replay, the trace's."""
    raw: Sequence[float | None]
    """Each input as it was read."""
    estimate: Estimate
    age_s: float | None
    """Since the estimate last used current readings alone; None where it never did."""
    missed_ticks: int = 0
    """Since the start or the last reload."""
    clock_steps_back: int = 0


def as_json(report: Report) -> str:
    """``report`` as one JSON object on one line, without the newline; what is not known is null."""
    import json  # a daemon that publishes files alone does without

    estimate = report.estimate
    return json.dumps(
        {
            "time_s": report.time_s,
            "model": report.model,
            "status": estimate.status,
            "ambient_degC": estimate.ambient_degC,
            "low_degC": estimate.low_degC,
            "high_degC": estimate.high_degC,
            "level_percent": report.level_percent,
            "age_s": report.age_s,
            "missed_ticks": report.missed_ticks,
            "clock_steps_back": report.clock_steps_back,
            "sensors": {
                each.name: {"unit": each.unit, "raw": raw, "used": used}
                for each, raw, used in zip(report.inputs, report.raw, estimate.used)
            },
        }
    )
