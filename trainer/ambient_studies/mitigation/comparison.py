"""The whole comparison: identify the governor in the chamber, then let it work in every room, knowing this or that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.tracking import Tracker, nearest_discrete
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import Record, closed_loop, phone_zones
from ambient_studies.mitigation.room import Room
from ambient_studies.mitigation.setting import Setting
from ambient_studies.mitigation.training import identify, training_trace

Progress = Callable[[str, int, int], None]
"""What is under way, how much of it is done, of how much."""

_LEAST_IDLE_MIN, _MOST_IDLE_MIN = 20.0, 240.0


@dataclass(frozen=True)
class Comparison:
    """What was compared, and what happened."""

    model: Model
    identified: Identified
    setting: Setting
    records: tuple[Record, ...]


def compare(
    model: Model, sensor: str, setting: Setting, rooms: Sequence[Room], seeds: Sequence[int], progress: Progress
) -> Comparison:
    """Every room and seed with a governor on ``sensor``; raises :class:`Refused` before anything is simulated."""
    zones = {zone.name: zone for zone in phone_zones(model, sensor)}
    if setting.outage is not None and setting.outage.sensor not in zones:
        problem = f"neither the model nor the governor reads '{setting.outage.sensor}'"
        raise refuse("--lose", "", problem, f"lose one of {', '.join(zones)}")
    trace = training_trace(zones[sensor], progress=partial(progress, "training run"))
    identified = identify(trace)
    records = closed_loop(model, identified, setting, rooms, seeds, partial(progress, "rooms"))
    return Comparison(model, identified, setting, tuple(records))


def settling_min(model: Model, period_s: float) -> float:
    """How long a phone should have been on before it works, so that its estimate is trusted: 20 min to 4 h."""
    # five minutes more show that it is
    discrete = nearest_discrete(model.main, period_s)
    settled_s = (Tracker(model.main, discrete).settling_steps + 1) * discrete.period_s
    return min(max(_LEAST_IDLE_MIN, settled_s / 60 + 5), _MOST_IDLE_MIN)
