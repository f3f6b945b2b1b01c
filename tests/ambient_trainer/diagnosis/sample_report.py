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
    driver = "camera_supply_rail_power_mW"
    named = tuple(replace(each, cause=Cause("heat_source", "flash, battery", driver)) for each in whole.steps)
    signals = {**whole.signals, driver: 1500 * whole.signals["camera_on"]}
    return {
        "diagnosis": report_of(whole),
        "diagnosis of long names": report_of(replace(whole, steps=named, verdict=named[0], signals=signals)),
        "diagnosis of an unknown misfit": report_of(replace(whole, steps=(unknown,), verdict=unknown)),
        "diagnosis of nothing": report_of(replace(whole, steps=(), verdict=None, ranking=(), next_experiment="")),
    }
