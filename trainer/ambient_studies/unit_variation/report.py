"""The report of the study: how a model's errors scatter over the units, with and without their corrections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ambient_studies.unit_variation.study import CALIBRATION_DEGC, DAYS, KNOWN_MIN, LIE_DEGC, READING_SIGMA_DEGC, Study
from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table, palette, plots

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

WAYS = {"as it is": "", "corrected": "corrected_", "learnt": "learnt_"}
"""How a model runs on a unit, and what the names of those figures begin with."""

_COLOURS = dict(zip(WAYS, (palette.BASELINE, palette.ESTIMATE, palette.STEP_COLOURS[1])))
_HEIGHT_PX = 330
_CAPTION = (
    "RMSE and bias (true minus estimate) in degC, over {} simulated units; ±: standard deviation from unit to unit. In "
    "90 %: the percentage of errors in the interval that the model publishes."
)
_ABOUT = (
    "A model of one simulated phone runs on others within the tolerances of manufacture, bare and in a case: as it is, "
    "with the offset of each unit's own calibration, and with the one learnt from one reading a day for a week. "
    "Calibrations and readings are made bare, at rest; the runs shown are others."
)


class Scatter(NamedTuple):
    """How a figure scatters over the units; deviation is the standard deviation."""

    nominal: float
    median: float
    p95: float
    worst: float
    mean: float
    deviation: float


def report_of(study: Study) -> Report:
    """What the study shows."""
    before, after, _ = (scatter(study, 0, f"{prefix}rmse_degC").median for prefix in WAYS.values())
    facts = [
        ("model", f"{study.model.name}, reads {', '.join(each.name for each in study.model.main.inputs)}"),
        ("units", f"{len(study.units)} simulated ones, drawn from seed {study.plan.seed}, and the nominal one"),
        ("weather", "the same for all; a calibration has its own"),
        ("samples", f"one every {study.plan.period_s:g} s"),
    ]
    return Report(
        subject="Unit-to-unit variation, simulated",
        title=f"{study.model.name} on {len(study.units)} other units: median error {before:.2f} degC, {after:.2f} with "
        "each unit's own offset",
        lead=[_ABOUT, Facts(facts)],
        sections=[
            Section("", [units_table(study), *map(Finding, sentences(study))]),
            *(
                Section(
                    f"Scenario {scenario}, {_dress(cased)}",
                    [
                        Figure(
                            partial(_rmse_figure, study, index),
                            "RMSE of all units, the best first: which share of them is better than a given error.",
                        ),
                        Figure(
                            partial(_bias_figure, study, index),
                            "Each unit's bias with its correction against the one without it; dotted: as before.",
                        ),
                    ],
                    detail=True,
                )
                for index, (scenario, cased) in enumerate(groups(study))
            ),
        ],
        data=as_json(study),
    )


def groups(study: Study) -> list[tuple[str, bool]]:
    """Scenario, and whether in a case, of each of a unit's runs, in order."""
    return [(each.scenario, each.cased) for each in study.nominal.scores]


def figures(study: Study, group: int, name: str) -> list[float]:
    """The figure ``name`` of the runs of a group, by unit."""
    return [getattr(each.scores[group], name) for each in study.units]


def scatter(study: Study, group: int, name: str) -> Scatter:
    """How the figure ``name`` of the runs of a group scatters."""
    values = figures(study, group, name)
    return Scatter(
        nominal=getattr(study.nominal.scores[group], name),
        median=float(np.median(values)),
        p95=float(np.percentile(values, 95)),
        worst=max(values, key=abs),
        mean=float(np.mean(values)),
        deviation=float(np.std(values)),
    )


def units_table(study: Study) -> Table:
    """How the units scatter, two rows a group."""
    columns = ("scenario", "phone", "model", "trained unit", "median", "95 %", "worst", "bias", "in 90 %")
    rows = []
    for index, (scenario, cased) in enumerate(groups(study)):
        for way, prefix in WAYS.items():
            off, bias, inside = (
                scatter(study, index, prefix + name) for name in ("rmse_degC", "bias_degC", "inside90_percent")
            )
            where = ("", "") if prefix else (scenario, _dress(cased))
            errors = (f"{value:.2f}" for value in (off.nominal, off.median, off.p95, off.worst))
            rows.append((*where, way, *errors, f"{bias.mean:+.2f} ± {bias.deviation:.2f}", f"{inside.mean:.0f}"))
    return Table(_CAPTION.format(len(study.units)), columns, rows, labels=3)


def sentences(study: Study) -> Iterator[str]:
    """A sentence a group, and two about the offsets."""
    for index, (scenario, cased) in enumerate(groups(study)):
        before, after, learnt = (scatter(study, index, f"{prefix}rmse_degC") for prefix in WAYS.values())
        best = scatter(study, index, "scatter_degC")
        yield (
            f"Scenario {scenario}, {_dress(cased)}: the error is {before.median:.2f} degC on the median unit "
            f"({before.nominal:.2f} on the one it was trained on), {after.median:.2f} with the unit's own offsets, "
            f"{learnt.median:.2f} (worst {learnt.worst:.2f}) with the one that it learnt. The "
            f"best constant, known afterwards, would leave {best.median:.2f}."
        )
    offsets = [each.offset_degC for each in study.units]
    yield (
        f"The main estimator's offset, of {KNOWN_MIN:g} minutes at rest at {CALIBRATION_DEGC:g} degC, is "
        f"{np.mean(offsets):+.2f} ± {np.std(offsets):.2f} degC (standard deviation from unit to unit); the trained "
        f"unit's own would be {study.nominal.offset_degC:+.2f}."
    )
    yield (
        f"One reading a day for {DAYS} days, with a normal error of {READING_SIGMA_DEGC:g} degC: readings that are all "
        f"{LIE_DEGC:g} degC too high move no unit's offset by more than "
        f"{max(each.liar_moves_degC for each in study.units):.2f} degC."
    )


def as_json(study: Study) -> dict[str, Any]:
    """All figures, and every unit's."""
    names = ("rmse_degC", "bias_degC", "inside90_percent")
    return {
        "simulated": True,
        "model": study.model.name,
        "plan": asdict(study.plan),
        "groups": [
            {
                "scenario": scenario,
                "cased": cased,
                **{
                    way: {name: scatter(study, index, prefix + name)._asdict() for name in names}
                    for way, prefix in WAYS.items()
                },
            }
            for index, (scenario, cased) in enumerate(groups(study))
        ],
        "units": [asdict(each) for each in (study.nominal, *study.units)],
    }


def _dress(cased: bool) -> str:
    return "in its case" if cased else "bare"


def _rmse_figure(study: Study, group: int) -> go.Figure:
    figure = plots.panel_figure("share of units that are better [%]", "RMSE [°C]", _HEIGHT_PX)
    for way, prefix in WAYS.items():
        values = np.array(figures(study, group, f"{prefix}rmse_degC"))
        order = np.argsort(values)
        shares = 100 * (np.arange(len(values)) + 0.5) / len(values)
        hover = [f"unit {study.units[index].number}" for index in order]
        plots.add_curve(figure, shares.tolist(), values[order].tolist(), way, _COLOURS[way], hover=hover)
    trained = study.nominal.scores[group].rmse_degC
    name = "the unit it was trained on"
    plots.add_curve(figure, [0, 100], [trained, trained], name, palette.INK, dash="dash", width=1.4)
    figure.update_yaxes(rangemode="tozero")
    figure.update_xaxes(range=[0, 100])
    return figure


def _bias_figure(study: Study, group: int) -> go.Figure:
    figure = plots.panel_figure("bias as it is [°C]", "bias corrected [°C]", _HEIGHT_PX)
    names = [f"{prefix}bias_degC" for prefix in ("", "corrected_")]
    x, y = (figures(study, group, name) for name in names)
    edge = 1.1 * max(*map(abs, x), *map(abs, y), 0.1)
    line = {"color": palette.AXIS, "dash": "dot", "width": 1.4}
    figure.add_scatter(x=[-edge, edge], y=[-edge, edge], mode="lines", line=line, name="as before", hoverinfo="skip")
    nominal = [getattr(study.nominal.scores[group], name) for name in names]
    units = [f"unit {unit.number}" for unit in study.units]
    dots = {"mode": "markers", "hovertemplate": "%{text} %{x:.2f}, corrected %{y:.2f} °C"}
    trained = {"color": palette.INK, "size": 11, "symbol": "diamond"}
    figure.add_scatter(x=x, y=y, text=units, name="a unit", marker={"color": palette.ESTIMATE, "size": 8}, **dots)
    at = {"x": nominal[:1], "y": nominal[1:]}
    figure.add_scatter(**at, text=[""], name="the unit it was trained on", marker=trained, **dots)
    return figure
