"""The reports of fits, evaluations, comparisons, identifiability and a correction, on small synthetic data."""

from dataclasses import replace
from functools import cache

import numpy as np

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.estimators import report as fit_report
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.registry import CircuitEstimator
from ambient_trainer.evaluation import compare, correction, identifiability_report
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.evaluation.identifiability import identifiability
from ambient_trainer.evaluation.report import report_of
from ambient_trainer.report import Report

from .conftest import BASELINE, guarded_model, sensor_trace, two_sensor_model

HOSTILE = "</script><script>alert(1)</script>"


@cache
def samples() -> dict[str, Report]:
    model = two_sensor_model({"circuit": "two & <one>", "baseline": BASELINE})
    holed = sensor_trace(30_000)
    holed.columns["usb_degC"][9_000:9_200] = np.nan
    several = [
        evaluate_trace(model, replace(each, path=name)) for each, name in ((holed, "a"), (sensor_trace(500), "b"))
    ]
    training = replace(several[1], overlaps_training=True, trace=HOSTILE)
    line = load_circuit("linear_usb")
    fit = CircuitEstimator(line).fit([sensor_trace(300)], Effort(starts=1))
    contender = compare.ScoredFit(fit, model, several[1], several[0])
    return {
        "evaluation": report_of(model, several),
        "evaluation on training data": report_of(model._replace(name=HOSTILE), [training]),
        "evaluation of a blended model": report_of(
            guarded_model(), [evaluate_trace(guarded_model(), sensor_trace(500))]
        ),
        "fit": fit_report.report_of(fit),
        "comparison": compare.report_of([contender]),
        "identifiability": identifiability_report.report_of(
            identifiability(line, sensor_trace(300), {}, Effort(starts=1), 2)
        ),
        "correction": correction.report_of(correction.correction(model, sensor_trace(300))),
    }
