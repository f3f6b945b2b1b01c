"""The scores of the closed loop: the skin's temperature, the time above its limit, and the work done.

Only the time of the work counts. Work is the SoC's energy above standby, as a share of the same energy in the same room
without a governor (the die's own protection alone).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambient_studies.mitigation.loop import Record
from ambient_studies.mitigation.setting import Knowledge, Room, Setting
from ambient_trainer.simulator import load_device


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


def scores(records: Sequence[Record], setting: Setting) -> list[Score]:
    """A score for every room and governor, in the records' order."""
    groups: dict[tuple[Room, Knowledge], list[Record]] = {}
    for record in records:
        groups.setdefault((record.case.room, record.case.knowledge), []).append(record)
    device = load_device()
    standby_W = device.activities[device.idle].heat_W[device.processor.node]

    def work_J(record: Record) -> float:
        return float((record.soc_W[record.time_s >= 0] - standby_W).sum()) * setting.period_s

    free_J = {
        (each.case.room, each.case.seed): work_J(each) for each in records if each.case.knowledge is Knowledge.NOTHING
    }
    shares = [[work_J(each) / free_J[each.case.room, each.case.seed] for each in group] for group in groups.values()]
    return [_score(group, setting, float(np.mean(work))) for group, work in zip(groups.values(), shares)]


def _score(group: Sequence[Record], setting: Setting, work_frac: float) -> Score:
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
