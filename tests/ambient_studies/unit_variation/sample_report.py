"""A study of synthetic units, as a report."""

from __future__ import annotations

from functools import cache

import numpy as np

from ambient_studies.unit_variation.report import report_of
from ambient_studies.unit_variation.study import Plan, Score, ScoredUnit, Study
from ambient_trainer.report import Report

from .conftest import mean_model


@cache
def samples() -> dict[str, Report]:
    random = np.random.default_rng(1)

    def unit(number: int) -> ScoredUnit:
        offset, rest = random.normal(0, 0.4), abs(random.normal(0.3, 0.05))
        scores = [
            Score("4", cased, float(np.hypot(offset, rest)), offset, rest, 60.0, rest, 0.1 * offset, 88.0)
            for cased in (False, True)
        ]
        return ScoredUnit(number, offset, tuple(scores))

    units = tuple(map(unit, range(12)))
    return {"units": report_of(Study(mean_model(), Plan(11, 1, ("4",), 1.0), units[0], units[1:]))}
