"""A made-up diagnosis as a report: of two effects, of an unknown misfit, and of nothing."""

from dataclasses import replace
from functools import cache

from ambient_trainer.diagnosis.report import report_of
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.report import Report

from .conftest import made_diagnosis


@cache
def samples() -> dict[str, Report]:
    whole = made_diagnosis()
    unknown = replace(whole.steps[0], cause=Cause("unknown"), magnitude=None, sentence="It is 0.91 degC off.")
    return {
        "diagnosis": report_of(whole),
        "diagnosis of an unknown misfit": report_of(replace(whole, steps=(unknown,), verdict=unknown)),
        "diagnosis of nothing": report_of(replace(whole, steps=(), verdict=None, ranking=(), next_experiment="")),
    }
