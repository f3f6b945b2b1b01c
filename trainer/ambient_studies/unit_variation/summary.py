"""The study in words: a table of how the units scatter, sentences, and the same for a machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from ambient_studies.unit_variation.runs import CALIBRATION_DEGC, KNOWN_MIN
from ambient_studies.unit_variation.study import Score, Study
from ambient_trainer.report.table import Table


class Group(NamedTuple):
    """The runs of one scenario, bare or cased."""

    scenario: str
    cased: bool

    @property
    def dress(self) -> str:
        """Bare or in its case."""
        return "in its case" if self.cased else "bare"


class Scatter(NamedTuple):
    """How a figure scatters over the units."""

    nominal: float
    median: float
    p95: float
    worst: float
    mean: float
    deviation: float


class Way(NamedTuple):
    """How a model runs on a unit, and the figures of that."""

    name: str
    rmse_degC: Callable[[Score], float]
    bias_degC: Callable[[Score], float]
    inside90_percent: Callable[[Score], float]


WAYS = (
    Way("as it is", lambda each: each.rmse_degC, lambda each: each.bias_degC, lambda each: each.inside90_percent),
    Way(
        "corrected",
        lambda each: each.corrected_rmse_degC,
        lambda each: each.corrected_bias_degC,
        lambda each: each.corrected_inside90_percent,
    ),
)


def groups(study: Study) -> list[Group]:
    """The kinds of runs, in order."""
    return [Group(each.scenario, each.cased) for each in study.nominal.scores]


def scatter(study: Study, group: Group, of: Callable[[Score], float]) -> Scatter:
    """How a figure of the runs of ``group`` scatters; deviation is the standard deviation over the units."""
    values = figures(study, group, of)
    return Scatter(
        nominal=of(study.nominal.scores[groups(study).index(group)]),
        median=float(np.median(values)),
        p95=float(np.percentile(values, 95)),
        worst=max(values, key=abs),
        mean=float(np.mean(values)),
        deviation=float(np.std(values)),
    )


def figures(study: Study, group: Group, of: Callable[[Score], float]) -> list[float]:
    """A figure of the runs of ``group``, by unit."""
    index = groups(study).index(group)
    return [of(each.scores[index]) for each in study.units]


def units_table(study: Study) -> Table:
    """How the units scatter, two rows a group."""
    rows = []
    for group in groups(study):
        for way in WAYS:
            off, mean, held = (scatter(study, group, of) for of in way[1:])
            rows.append(
                (
                    *((group.scenario, group.dress) if way is WAYS[0] else ("", "")),
                    way.name,
                    *(f"{value:.2f}" for value in (off.nominal, off.median, off.p95, off.worst)),
                    f"{mean.mean:+.2f} ± {mean.deviation:.2f}",
                    f"{held.mean:.0f}",
                )
            )
    caption = (
        f"RMSE and bias (true minus estimate) in degC, over {len(study.units)} simulated units; ±: standard deviation "
        "from unit to unit. In 90 %: the percentage of errors in the interval that the model publishes."
    )
    columns = ("scenario", "phone", "model", "trained unit", "median", "95 %", "worst", "bias", "in 90 %")
    return Table(caption, columns, tuple(rows), labels=3)


def sentences(study: Study) -> list[str]:
    """What comes of it, a sentence each."""
    told = []
    for group in groups(study):
        before, after = (scatter(study, group, way.rmse_degC) for way in WAYS)
        best = scatter(study, group, lambda each: each.scatter_degC)
        told.append(
            f"Scenario {group.scenario}, {group.dress}: {before.median:.2f} degC off on the median unit "
            f"({before.nominal:.2f} on the one it was trained on), {after.median:.2f} with the unit's own offsets. The "
            f"best constant added to what it says as it is, known afterwards, would leave {best.median:.2f}."
        )
    offsets = [each.offset_degC for each in study.units]
    told.append(
        f"The main estimator's offset, of {KNOWN_MIN:g} minutes at rest at {CALIBRATION_DEGC:g} degC, is "
        f"{np.mean(offsets):+.2f} ± {np.std(offsets):.2f} degC (standard deviation from unit to unit); the trained "
        f"unit's own would be {study.nominal.offset_degC:+.2f}."
    )
    return told


def as_json(study: Study) -> dict[str, Any]:
    """All figures, and every unit's."""
    return {
        "simulated": True,
        "model": study.model.name,
        "plan": asdict(study.plan),
        "groups": [
            {
                "scenario": group.scenario,
                "cased": group.cased,
                **{
                    way.name: {
                        "rmse_degC": scatter(study, group, way.rmse_degC)._asdict(),
                        "bias_degC": scatter(study, group, way.bias_degC)._asdict(),
                        "inside90_percent": scatter(study, group, way.inside90_percent)._asdict(),
                    }
                    for way in WAYS
                },
            }
            for group in groups(study)
        ],
        "units": [asdict(each) for each in (study.nominal, *study.units)],
    }
