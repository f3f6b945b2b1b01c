"""The report of the comparison: scores by room and governor, and skin, power and ambient over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ambient_studies.mitigation.comparison import SCENARIO, Comparison, Score, scores
from ambient_studies.mitigation.loop import LoopLog
from ambient_studies.mitigation.setting import Knowledge, Setting
from ambient_trainer.data import Array
from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table, palette, plots

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

_NOTICED_FRAC = 0.02  # differences of work below this are not named; chosen
_NOTICED_MIN = 0.5  # nor those of the time above the limit; chosen
_BEFORE_S = 300.0
_STYLES = {
    Knowledge.NOTHING: (palette.LIGHT, 7.0),
    Knowledge.USUAL: (palette.SAND, 4.6),
    Knowledge.TRUTH: (palette.SKY, 3.0),
    Knowledge.HOTTEST: (palette.ORANGE, 1.6),
    Knowledge.ESTIMATE: (palette.BLUE, 1.6),
}
"""Colour and width, widest first: curves below stay visible as a rim where they coincide."""
_IDENTIFIED = ("rmse_degC", "margin_K", "resistance_K_W", "time_constant_s")
_ABOUT = (
    "One governor caps the processor of a simulated phone so that its skin stays below a limit. The rows differ only "
    "in the ambient that the governor uses: an assumption, the estimate that the device's own recursion makes of the "
    "phone's sensors in the loop, or the truth. Without a governor only the die's own protection acts."
)


def report_of(comparison: Comparison) -> Report:
    """What the comparison shows; of each room the page draws the first seed."""
    records, setting = comparison.records, comparison.setting
    scored = scores(records, setting)
    drawn: dict[str, dict[Knowledge, LoopLog]] = {}
    for record in records:
        if record.case.seed == records[0].case.seed:
            drawn.setdefault(record.case.room.name, {})[record.case.knowledge] = record
    shares = {
        kind: [100 * each.work_frac for each in scored if each.knowledge is kind]
        for kind in (Knowledge.ESTIMATE, Knowledge.HOTTEST)
    }
    mine, hottest = (f"{min(each):.0f} to {max(each):.0f} %" for each in shares.values())
    return Report(
        subject="Thermal mitigation, simulated",
        title=f"{mine} of the work with the estimate, {hottest} where {setting.hottest_degC:g} degC is assumed",
        lead=[
            _ABOUT,
            Finding(f"Governor on {comparison.identified.sensor}: {comparison.identified}."),
            Finding(f"{fixed_trip(comparison)}."),
            Facts(_facts(comparison)),
        ],
        sections=[
            Section("", [score_table(scored, setting), *map(Finding, verdict(scored, setting))]),
            *(
                Section(f"{name} degC", [Figure(partial(_room_figure, by_knowledge, setting))], detail=True)
                for name, by_knowledge in drawn.items()
            ),
        ],
        data=as_data(comparison, scored),
        footnotes=["The work begins at 0."],
    )


def score_table(scored: Sequence[Score], setting: Setting) -> Table:
    """The scores as a table."""
    names = governor_names(setting)
    columns: dict[str, Callable[[Score], str]] = {
        "room": lambda each: each.room,
        "governor": lambda each: names[each.knowledge],
        "max skin": lambda each: f"{each.max_skin_degC:.1f}",
        "95 % skin": lambda each: f"{each.p95_skin_degC:.1f}",
        "min above": lambda each: f"{each.above_limit_min:.1f}",
        "SoC [W]": lambda each: f"{each.soc_W:.2f}",
        "work": lambda each: f"{100 * each.work_frac:.0f} %",
        "RMSE": lambda each: "-" if each.estimate_rmse_degC is None else f"{each.estimate_rmse_degC:.2f}",
    }
    caption = (
        f"Simulated. {setting.work_min:g} min of {setting.workload}; temperatures in degC. Skin: the hottest of "
        f"display, back and frame; max: of all runs; 95 %: percentile over time. Min above: minutes above "
        f"{setting.limit_degC:g} degC. Work: the SoC's energy above standby, as a share of that without a governor. "
        "RMSE: of the estimate."
    )
    return Table(caption, [*columns], [[of(each) for of in columns.values()] for each in scored], labels=2)


def verdict(scored: Sequence[Score], setting: Setting) -> list[str]:
    """A sentence a room: the gain by the estimate, or that there is none."""
    by_place = {(each.room, each.knowledge): each for each in scored}
    return ["".join(_phrases(by_place, room, setting)) for room in dict.fromkeys(each.room for each in scored)]


def governor_names(setting: Setting) -> dict[Knowledge, str]:
    """How tables and plots name each governor."""
    return {
        Knowledge.NOTHING: "none",
        Knowledge.HOTTEST: f"assumes {setting.hottest_degC:g} degC",
        Knowledge.USUAL: f"assumes {setting.usual_degC:g} degC",
        Knowledge.ESTIMATE: "has the estimate",
        Knowledge.TRUTH: "knows the truth",
    }


def fixed_trip(comparison: Comparison) -> str:
    """The fixed trip points that are equivalent to the assumed ambients."""
    setting, identified = comparison.setting, comparison.identified
    trips = [identified.trip_degC(setting.limit_degC, each) for each in (setting.hottest_degC, setting.usual_degC)]
    governor = setting.phone.processor.governor
    assert governor
    never = " (out of reach: the die's own protection acts before)" if trips[1] > governor.high_degC else ""
    return (
        f"To assume {setting.hottest_degC:g} degC is to hold {identified.sensor} at {trips[0]:.0f} degC, "
        f"{setting.usual_degC:g} degC at {trips[1]:.0f} degC{never}"
    )


def as_data(comparison: Comparison, scored: Sequence[Score]) -> dict[str, Any]:
    """All figures, and the governor's parameters."""
    identified, setting = comparison.identified, comparison.setting
    return {
        "simulated": True,
        "model": comparison.model.name,
        "seeds": _seeds(comparison),
        "setting": asdict(setting),
        "governor": {
            "sensor": identified.sensor,
            "rest_gains": dict(zip((identified.sensor, "ambient"), identified.dc_gains)),
            **{name: getattr(identified, name) for name in _IDENTIFIED},
        },
        "rows": [
            {
                "told" if name == "knowledge" else name: getattr(value, "name", value)
                for name, value in vars(each).items()
            }
            for each in scored
        ],
        "verdict": verdict(scored, setting),
    }


def _seeds(comparison: Comparison) -> list[int]:
    return list(dict.fromkeys(each.case.seed for each in comparison.records))


def _phrases(by_place: dict[tuple[str, Knowledge], Score], room: str, setting: Setting) -> Iterator[str]:
    mine, hottest, usual, truth = (
        by_place[room, kind] for kind in (Knowledge.ESTIMATE, Knowledge.HOTTEST, Knowledge.USUAL, Knowledge.TRUTH)
    )
    gain = mine.work_frac - hottest.work_frac
    yield (
        f"{room} degC: {100 * mine.work_frac:.0f} % of the work with the estimate, {100 * hottest.work_frac:.0f} % "
        f"where {setting.hottest_degC:g} degC is assumed"
    )
    if hottest.above_limit_min > mine.above_limit_min + _NOTICED_MIN:
        yield f" and the skin is {_above(hottest, setting)}"
    elif abs(gain) < _NOTICED_FRAC:
        yield "; here the estimate is worth nothing"
    elif gain < 0:
        yield "; here its error costs work"
    yield "."
    if usual.above_limit_min > mine.above_limit_min + _NOTICED_MIN:
        yield f" Where {setting.usual_degC:g} degC is assumed, the skin is {_above(usual, setting)}."
    if mine.max_skin_degC > setting.limit_degC:
        yield (
            f" With the estimate the skin is {_above(mine, setting)}, with the truth for "
            f"{truth.above_limit_min:.1f} min."
        )
    if mine.trusted_frac is not None and mine.trusted_frac < 1:
        yield (
            f" The estimate was trusted {100 * mine.trusted_frac:.0f} % of the time; else {setting.hottest_degC:g} "
            "degC was assumed."
        )


def _above(score: Score, setting: Setting) -> str:
    return (
        f"above {setting.limit_degC:g} degC for {score.above_limit_min:.1f} of {setting.work_min:g} min, up to "
        f"{score.max_skin_degC:.1f} degC"
    )


def _facts(comparison: Comparison) -> list[tuple[str, str]]:
    model, setting, seeds = comparison.model, comparison.setting, _seeds(comparison)
    air = "as in the climate chamber, moved by its fan"
    if setting.convection_W_m2_K125 is not None:
        air = f"of convection {setting.convection_W_m2_K125:g} W/(m² K^1.25); model and governor come from the chamber"
    return [
        ("phone", f"simulated; {setting.workload} for {setting.work_min:g} min after {setting.idle_min:.0f} min idle"),
        ("limit", f"{setting.limit_degC:g} degC for the hottest of display, back and frame"),
        ("ambient model", f"{model.name}, reads {', '.join(each.name for each in model.main.inputs)}"),
        ("governor", f"identified on the thesis's scenario {SCENARIO}, in the chamber"),
        ("air", air),
        ("runs", f"{len(seeds)} a room, from seed {seeds[0]}; the plots show the first"),
    ]


def _room_figure(by_knowledge: dict[Knowledge, LoopLog], setting: Setting) -> go.Figure:
    names = {kind: name.replace("degC", "°C") for kind, name in governor_names(setting).items()}
    mine = by_knowledge[Knowledge.ESTIMATE]
    shown = mine.time_s >= -_BEFORE_S
    time_s = mine.time_s[shown]

    def lines(of: Callable[[LoopLog], Array]) -> list[plots.Line]:
        return [plots.Line(names[kind], of(by_knowledge[kind])[shown], *style) for kind, style in _STYLES.items()]

    limit = plots.Line("limit", np.full(len(time_s), setting.limit_degC), palette.LIMIT, 1.0)
    ambient = [
        plots.Line("ambient in use", mine.used_degC[shown], palette.SAND, 5.0),
        plots.Line("air", mine.air_degC[shown], palette.INK),
        plots.Line("estimate", mine.estimate_degC[shown], palette.BLUE, 1.0),
    ]
    panels = [
        plots.Panel("skin [°C]", [limit, *lines(lambda each: each.skin_degC)], height_px=300),
        plots.Panel("SoC [W]", lines(lambda each: each.soc_W), height_px=260),
        plots.Panel("ambient [°C]", ambient, height_px=240),
    ]
    return plots.stacked_figure(time_s, panels)
