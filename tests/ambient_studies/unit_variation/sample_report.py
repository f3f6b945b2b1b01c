"""A study of synthetic units, as a report."""

from __future__ import annotations

from functools import cache

import numpy as np

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model
from ambient_studies.unit_variation.report import report_of
from ambient_studies.unit_variation.study import Plan, Score, ScoredUnit, Study
from ambient_trainer.report import Report

_DISCRETE = (Discrete(1.0, (), (), ((),), ((1.0,),)),)
_BANDS = {50: (-0.1, 0.1), 90: (-0.2, 0.2), 98: (-0.3, 0.3)}
_MAIN = Estimator((Input("usb", "degC", "usb", -45.0, 130.0),), (), _DISCRETE, 0.0, (), _BANDS)
_MODEL = Model("usb", "2024-01-01T00:00:00Z", "ambient", _MAIN, {}, {}, conformance_of(_MAIN, ((20.0,),)))


@cache
def samples() -> dict[str, Report]:
    random = np.random.default_rng(1)

    def unit(number: int) -> ScoredUnit:
        offset, rest = random.normal(0, 0.4), abs(random.normal(0.3, 0.05))
        scores = [
            Score(
                "4",
                cased,
                float(np.hypot(offset, rest)),
                offset,
                rest,
                60.0,
                rest,
                0.1 * offset,
                88.0,
                rest,
                0.2 * offset,
                90.0,
            )
            for cased in (False, True)
        ]
        return ScoredUnit(number, offset, tuple(scores), 0.8 * offset, 0.1)

    units = tuple(map(unit, range(12)))
    return {"units": report_of(Study(_MODEL, Plan(11, 1, ("4",), 1.0), units[0], units[1:]))}
