"""The comparison: identify the governor in the chamber, simulate it in every room with every knowledge, and score it.

In the thesis's scenario 5 thermocouples lie on the skin and in the air, and the phone logs its sensor and the SoC's
power. A free filter of order 1 is fitted twice: to the skin from the sensor and the air, and to the skin from the SoC's
power and the air; the second gives the rise per W and its time constant. The rooms are no part of it.

Scores are of the time of the work only. Work is the SoC's energy above standby, as a share of the same energy in the
same room without a governor (the die's own protection alone).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.trace import REFERENCE
from ambient_model.tracking import Tracker, nearest_discrete
from ambient_studies import Progress
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import LoopLog, closed_loop, phone_zones, skin_degC
from ambient_studies.mitigation.setting import Knowledge, Room, Setting
from ambient_trainer.data import Trace
from ambient_trainer.estimators import Effort, Fit, FreeFilterEstimator
from ambient_trainer.simulator import Planned, Probes, Zone, load_device, load_scenario, logged, prepare, stream

SCENARIO = "5"
SEED = 0
PERIOD_S = 1.0
_AIR, _POWER = "air_degC", "soc_power_W"
_MARGIN_PERCENT = 95


def training_trace(zone: Zone, progress: Callable[[int, int], None] | None = None) -> Trace:
    """The run: ``zone``'s column, ``air_degC``, ``soc_power_W``, and the skin as the reference."""
    phone = load_device()
    run = prepare(load_scenario(SCENARIO), SEED, PERIOD_S, phone)
    trace, driven, _ = logged([Planned(SCENARIO, SEED, run, [zone])], PERIOD_S, progress)[0]
    skin = Probes().reading(skin_degC(driven.nodes_degC), PERIOD_S, stream(SEED, "skin"))[run.unrecorded :]
    sensor = f"{zone.name}_degC"
    columns = {sensor: trace.column(sensor), _AIR: trace.reference, _POWER: trace.column(_POWER), REFERENCE: skin}
    return replace(trace, columns=columns)


def identify(trace: Trace) -> Identified:
    """Identify a governor on the trace's first column."""
    sensor = next(iter(trace.columns))
    skin, power = _fit(trace, sensor), _fit(trace, _POWER)
    return Identified(
        sensor=sensor.removesuffix("_degC"),
        skin=skin.system,
        hold=skin.hold,
        rmse_degC=skin.rmse_degC,
        margin_K=max(0.0, float(np.percentile(skin.errors_degC[0], _MARGIN_PERCENT))),
        resistance_K_W=power.dc_gains[0],
        time_constant_s=float(-1.0 / power.system.A[0, 0]),
    )


def _fit(trace: Trace, driver: str) -> Fit:
    return FreeFilterEstimator(1).fit([trace], Effort(starts=4), inputs=(driver, _AIR))


_LEAST_IDLE_MIN, _MOST_IDLE_MIN = 20.0, 240.0


@dataclass(frozen=True)
class Comparison:
    """Model, governor and setting of a comparison, and its records."""

    model: Model
    identified: Identified
    setting: Setting
    records: tuple[LoopLog, ...]


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


@dataclass(frozen=True)
class Score:
    """One governor in one room: the maximum over all seeds, and means of everything else."""

    room: str
    knowledge: Knowledge
    max_skin_degC: float
    p95_skin_degC: float
    """The 95th percentile over time."""
    above_limit_min: float
    soc_W: float
    work_frac: float
    estimate_rmse_degC: float | None
    """None without an estimate."""
    trusted_frac: float | None
    """The share of the time in which the governor used the estimate."""


def scores(records: Sequence[LoopLog], setting: Setting) -> list[Score]:
    """A score for every room and governor, in the records' order."""
    groups: dict[tuple[Room, Knowledge], list[LoopLog]] = {}
    for record in records:
        groups.setdefault((record.case.room, record.case.knowledge), []).append(record)
    device = load_device()
    standby_W = device.activities[device.idle].heat_W[device.processor.node]

    def work_J(record: LoopLog) -> float:
        return float((record.soc_W[record.time_s >= 0] - standby_W).sum()) * setting.period_s

    free_J = {
        (each.case.room, each.case.seed): work_J(each) for each in records if each.case.knowledge is Knowledge.NOTHING
    }
    shares = [[work_J(each) / free_J[each.case.room, each.case.seed] for each in group] for group in groups.values()]
    return [_score(group, setting, float(np.mean(work))) for group, work in zip(groups.values(), shares)]


def _score(group: Sequence[LoopLog], setting: Setting, work_frac: float) -> Score:
    case, working = group[0].case, group[0].time_s >= 0
    skin = np.array([each.skin_degC[working] for each in group])
    errors = np.array([(each.estimate_degC - each.air_degC)[working] for each in group])
    errors = errors[np.isfinite(errors)]
    estimating = case.knowledge is Knowledge.ESTIMATE
    return Score(
        room=case.room.name,
        knowledge=case.knowledge,
        max_skin_degC=float(skin.max()),
        p95_skin_degC=float(np.percentile(skin, 95, axis=1).mean()),
        above_limit_min=float((skin > setting.limit_degC).sum(axis=1).mean() * setting.period_s / 60),
        soc_W=float(np.mean([each.soc_W[working].mean() for each in group])),
        work_frac=work_frac,
        estimate_rmse_degC=float(np.sqrt(np.mean(errors**2))) if len(errors) else None,
        trusted_frac=float(np.mean([each.trusted[working].mean() for each in group])) if estimating else None,
    )
