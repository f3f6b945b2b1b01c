"""A study of synthetic units, as a report."""

from functools import cache

import numpy as np

from ambient_studies.unit_variation.report import report_of
from ambient_studies.unit_variation.study import Plan, Score, ScoredUnit, Study
from ambient_trainer.report import Report

from ..mitigation.sample_report import constant_model


@cache
def samples() -> dict[str, Report]:
    random = np.random.default_rng(1)

    def unit(number: int) -> ScoredUnit:
        offset, rest = random.normal(0, 0.4), abs(random.normal(0.3, 0.05))
        as_it_is = (float(np.hypot(offset, rest)), offset, rest, 60.0)
        corrected, learnt = (rest, 0.1 * offset, 88.0), (rest, 0.2 * offset, 90.0)
        scores = tuple(Score("4", cased, *as_it_is, *corrected, *learnt) for cased in (False, True))
        return ScoredUnit(number, offset, scores, 0.8 * offset, 0.1)

    units = tuple(map(unit, range(12)))
    return {"units": report_of(Study(constant_model(20.0), Plan(11, 1, ("4",), 1.0), units[0], units[1:]))}
