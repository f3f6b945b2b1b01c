"""The comparison as a page: what the estimate is worth, and per room skin, power and ambient over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from ambient_studies.mitigation.comparison import Comparison
from ambient_studies.mitigation.loop import Record
from ambient_studies.mitigation.score import fixed_trip, governor_names, score_table, scores, verdict
from ambient_studies.mitigation.setting import Setting, Told
from ambient_studies.mitigation.training import SCENARIO
from ambient_trainer.data import Array
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import (
    BLUE,
    INK,
    ORANGE,
    POINTS_PER_LINE,
    SAND,
    SKY,
    Line,
    Panel,
    stacked_figure,
    to_markup,
)
from ambient_trainer.report.table import Table

_STYLES = {
    Told.NOTHING: ("#c4c9d1", 7.0),
    Told.USUAL: (SAND, 4.6),
    Told.TRUTH: (SKY, 3.0),
    Told.HOTTEST: (ORANGE, 1.6),
    Told.ESTIMATE: (BLUE, 1.6),
}
"""Colour and width, as they are drawn one on the other: those below stay visible as a rim where they coincide."""
_LIMIT = "#dc2626"
_BEFORE_S = 300.0


def mitigation_page(comparison: Comparison) -> str:
    """The page as HTML; of each room it draws the first seed."""
    records, setting = comparison.records, comparison.setting
    found = scores(records, setting)
    seeds = list(dict.fromkeys(each.case.seed for each in records))
    drawn: dict[str, dict[Told, Record]] = {}
    for record in records:
        if record.case.seed == seeds[0]:
            drawn.setdefault(record.case.room.name, {})[record.case.told] = record
    return render(
        "mitigation.html",
        facts=_facts(comparison, seeds),
        verdict=verdict(found, setting),
        table=_shown(score_table(found, setting)),
        rooms=[
            {"title": f"{name} °C", "plots": _plots(by_told, setting, f"room-{number}")}
            for number, (name, by_told) in enumerate(drawn.items(), start=1)
        ],
        points=f"{POINTS_PER_LINE:,}",
    )


def _facts(comparison: Comparison, seeds: Sequence[int]) -> list[tuple[str, str]]:
    model, identified, setting = comparison.model, comparison.identified, comparison.setting
    air = "the climate chamber's, moved by its fan"
    if setting.convection_W_m2_K125 is not None:
        air = f"of convection {setting.convection_W_m2_K125:g} W/(m² K^1.25), model and governor come from the chamber"
    return [
        (
            "phone",
            f"simulated; {setting.workload} for {setting.work_min:g} min after {setting.idle_min:.0f} min idle",
        ),
        ("limit", f"{setting.limit_degC:g} °C for the hottest of display, back and frame"),
        ("ambient model", f"{model.name}, reads {', '.join(each.name for each in model.main.inputs)}"),
        ("governor", f"acts on {identified.sensor}; {identified}".replace("degC", "°C")),
        ("without the estimate", fixed_trip(comparison).replace("degC", "°C")),
        ("identified", f"on the thesis's scenario {SCENARIO}, in the chamber; the rooms are no part of it"),
        ("air", air),
        ("runs", f"{len(seeds)} a room, from seed {seeds[0]}; the plots show the first"),
    ]


def _plots(by_told: dict[Told, Record], setting: Setting, identity: str) -> list[Markup]:
    """Skin, power and ambient over time, one below the other."""
    names = {told: name.replace("degC", "°C") for told, name in governor_names(setting).items()}
    mine = by_told[Told.ESTIMATE]
    shown = mine.time_s >= -_BEFORE_S
    time_s = mine.time_s[shown]

    def lines(of: Callable[[Record], Array]) -> list[Line]:
        return [Line(names[told], of(by_told[told])[shown], *style) for told, style in _STYLES.items()]

    limit = Line("limit", np.full(len(time_s), setting.limit_degC), _LIMIT, 1.0)
    panels = [
        Panel("skin [°C]", [limit, *lines(lambda each: each.skin_degC)], height_px=300),
        Panel("SoC [W]", lines(lambda each: each.soc_W), height_px=260),
        Panel(
            "ambient [°C]",
            [
                Line("the governor goes by", mine.told_degC[shown], SAND, 5.0),
                Line("air", mine.air_degC[shown], INK),
                Line("estimate", mine.estimate_degC[shown], BLUE, 1.0),
            ],
            height_px=240,
        ),
    ]
    return [
        to_markup(stacked_figure(time_s, [panel]), f"{identity}-{number}")
        for number, panel in enumerate(panels, start=1)
    ]


def _shown(table: Table) -> Table:
    rows = tuple(tuple(cell.replace("degC", "°C") for cell in row) for row in table.rows)
    return replace(table, rows=rows)
