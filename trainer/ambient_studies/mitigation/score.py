"""What a run was worth: how hot the skin got, for how long beyond its limit, and how much work was done meanwhile.

Only the time of the work counts. Work is what the SoC drew above standby, as a share of what it draws in the same room
with no governor but the die's own protection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ambient_studies.mitigation.comparison import Comparison
from ambient_studies.mitigation.loop import Record
from ambient_studies.mitigation.room import Room
from ambient_studies.mitigation.setting import Setting, Told
from ambient_trainer.report.table import Table
from ambient_trainer.simulator.device_file import load_device

_NOTICED_FRAC = 0.02
_NOTICED_MIN = 0.5


@dataclass(frozen=True)
class Score:
    """One governor in one room, over all seeds: the hottest of them, and means of everything else."""

    room: str
    told: str
    max_skin_degC: float
    p95_skin_degC: float
    """95 % of the time the skin was below it."""
    above_limit_min: float
    soc_W: float
    work_frac: float
    estimate_rmse_degC: float | None
    """Of what the model said; None where it was not asked or said nothing."""
    trusted_frac: float | None
    """How much of the time the governor went by the estimate."""


def scores(records: Sequence[Record], setting: Setting) -> list[Score]:
    """A score for every room and governor, in the records' order."""
    groups: dict[tuple[Room, Told], list[Record]] = {}
    for record in records:
        groups.setdefault((record.case.room, record.case.told), []).append(record)
    free_J = {
        (each.case.room, each.case.seed): _work_J(each, setting) for each in records if each.case.told is Told.NOTHING
    }
    return [_score(group, setting, free_J) for group in groups.values()]


def score_table(found: Sequence[Score], setting: Setting) -> Table:
    """The scores as a table, for terminal and page."""
    names = governor_names(setting)
    rows = tuple(
        (
            each.room,
            names[Told[each.told]],
            f"{each.max_skin_degC:.1f}",
            f"{each.p95_skin_degC:.1f}",
            f"{each.above_limit_min:.1f}",
            f"{each.soc_W:.2f}",
            f"{100 * each.work_frac:.0f} %",
            "-" if each.estimate_rmse_degC is None else f"{each.estimate_rmse_degC:.2f}",
        )
        for each in found
    )
    columns = ("room", "governor", "max skin", "95 % skin", "min above", "SoC [W]", "work", "estimate off")
    caption = (
        f"Simulated. {setting.work_min:g} min of {setting.workload}; temperatures in degC. Skin: the hottest of "
        f"display, back and frame; max: of all runs; 95 % skin: it was cooler for 95 % of the time. Min above: minutes "
        f"above {setting.limit_degC:g} degC. Work: what the SoC drew above standby, as a share of what it draws with "
        "no governor but the die's own protection. Estimate off: RMSE against the air."
    )
    return Table(caption, columns, rows, labels=2)


def verdict(found: Sequence[Score], setting: Setting) -> list[str]:
    """What the estimate is worth in each room, and where it is worth nothing."""
    by_place = {(each.room, Told[each.told]): each for each in found}
    return [_sentence(by_place, room, setting) for room in dict.fromkeys(each.room for each in found)]


def governor_names(setting: Setting) -> dict[Told, str]:
    """What each governor is called."""
    return {
        Told.NOTHING: "none",
        Told.HOTTEST: f"assumes {setting.hottest_degC:g} degC",
        Told.USUAL: f"assumes {setting.usual_degC:g} degC",
        Told.ESTIMATE: "has the estimate",
        Told.TRUTH: "knows the truth",
    }


def fixed_trip(comparison: Comparison) -> str:
    """What an assumed ambient amounts to."""
    setting, identified = comparison.setting, comparison.identified
    trips = [identified.trip_degC(setting.limit_degC, each) for each in (setting.hottest_degC, setting.usual_degC)]
    governor = setting.phone.processor.governor
    assert governor
    never = " (which the die's own protection never lets it reach)" if trips[1] > governor.high_degC else ""
    return (
        f"To assume {setting.hottest_degC:g} degC is to hold {identified.sensor} at {trips[0]:.0f} degC, "
        f"{setting.usual_degC:g} degC at {trips[1]:.0f} degC{never}"
    )


def as_json(comparison: Comparison) -> dict[str, Any]:
    """What table and verdict show, with what the governor knows."""
    identified, setting = comparison.identified, comparison.setting
    found = scores(comparison.records, setting)
    return {
        "simulated": True,
        "model": comparison.model.name,
        "seeds": list(dict.fromkeys(each.case.seed for each in comparison.records)),
        "setting": asdict(setting),
        "governor": {
            "sensor": identified.sensor,
            "rest_gains": dict(zip((identified.sensor, "ambient"), identified.rest_gains)),
            "rmse_degC": identified.rmse_degC,
            "margin_K": identified.margin_K,
            "resistance_K_W": identified.resistance_K_W,
            "time_constant_s": identified.time_constant_s,
        },
        "rows": [asdict(each) for each in found],
        "verdict": verdict(found, setting),
    }


def _score(group: Sequence[Record], setting: Setting, free_J: dict[tuple[Room, int], float]) -> Score:
    case, working = group[0].case, group[0].time_s >= 0
    skin = np.array([each.skin_degC[working] for each in group])
    errors = np.array([(each.estimate_degC - each.air_degC)[working] for each in group])
    said = errors[np.isfinite(errors)]
    estimating = case.told is Told.ESTIMATE
    return Score(
        room=case.room.name,
        told=case.told.name,
        max_skin_degC=float(skin.max()),
        p95_skin_degC=float(np.percentile(skin, 95, axis=1).mean()),
        above_limit_min=float((skin > setting.limit_degC).sum(axis=1).mean() * setting.period_s / 60),
        soc_W=float(np.mean([each.soc_W[working].mean() for each in group])),
        work_frac=float(np.mean([_work_J(each, setting) / free_J[each.case.room, each.case.seed] for each in group])),
        estimate_rmse_degC=float(np.sqrt(np.mean(said**2))) if len(said) else None,
        trusted_frac=float(np.mean([each.trusted[working].mean() for each in group])) if estimating else None,
    )


def _work_J(record: Record, setting: Setting) -> float:
    drawn_W = record.soc_W[record.time_s >= 0]
    return float((drawn_W - _idle_W()).sum()) * setting.period_s


def _sentence(by_place: dict[tuple[str, Told], Score], room: str, setting: Setting) -> str:
    mine, hottest, usual, truth = (
        by_place[room, told] for told in (Told.ESTIMATE, Told.HOTTEST, Told.USUAL, Told.TRUTH)
    )
    gain = mine.work_frac - hottest.work_frac
    said = [
        f"{room} degC: {100 * mine.work_frac:.0f} % of the work with the estimate, {100 * hottest.work_frac:.0f} % "
        f"where {setting.hottest_degC:g} degC is assumed"
    ]
    if hottest.above_limit_min > mine.above_limit_min + _NOTICED_MIN:
        said.append(f" and the skin is {_above(hottest, setting)}")
    elif abs(gain) < _NOTICED_FRAC:
        said.append("; here the estimate is worth nothing")
    elif gain < 0:
        said.append("; here its error costs work")
    said.append(".")
    if usual.above_limit_min > mine.above_limit_min + _NOTICED_MIN:
        said.append(f" Where {setting.usual_degC:g} degC is assumed, the skin is {_above(usual, setting)}.")
    if mine.max_skin_degC > setting.limit_degC:
        said.append(
            f" With the estimate the skin is {_above(mine, setting)}, with the truth for "
            f"{truth.above_limit_min:.1f} min."
        )
    if mine.trusted_frac is not None and mine.trusted_frac < 1:
        said.append(
            f" The estimate was trusted {100 * mine.trusted_frac:.0f} % of the time; else {setting.hottest_degC:g} "
            "degC was assumed."
        )
    return "".join(said)


def _above(score: Score, setting: Setting) -> str:
    return (
        f"above {setting.limit_degC:g} degC for {score.above_limit_min:.1f} of {setting.work_min:g} min, up to "
        f"{score.max_skin_degC:.1f} degC"
    )


def _idle_W() -> float:
    """What the processor draws while the device idles."""
    device = load_device()
    return device.activities[device.idle].heat_W[device.processor.node]
