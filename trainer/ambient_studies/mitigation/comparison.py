"""The comparison: identify the governor in the chamber, then simulate it in every room with every knowledge."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.tracking import Tracker, nearest_discrete
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import Record, closed_loop, phone_zones
from ambient_studies.mitigation.setting import Room, Setting
from ambient_studies.mitigation.training import identify, training_trace

Progress = Callable[[str, int, int], None]
"""Stage, steps done, steps in all."""

_LEAST_IDLE_MIN, _MOST_IDLE_MIN = 20.0, 240.0


@dataclass(frozen=True)
class Comparison:
    """Model, governor and setting of a comparison, and its records."""

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
    """Idle time after which the estimate is trusted: the model's settling time and 5 min, within 20 min to 4 h."""
    discrete = nearest_discrete(model.main, period_s)
    settled_s = (Tracker(model.main, discrete).settling_steps + 1) * discrete.period_s
    return min(max(_LEAST_IDLE_MIN, settled_s / 60 + 5), _MOST_IDLE_MIN)
