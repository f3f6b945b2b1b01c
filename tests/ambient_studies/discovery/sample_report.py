"""A benchmark of 400 synthetic cases, and of few, as reports."""

from functools import cache

from ambient_studies.discovery.report import as_json, report_of
from ambient_trainer.report import Report

from .conftest import synthetic_outcomes


@cache
def samples() -> dict[str, Report]:
    outcomes = synthetic_outcomes()
    parts = {"all": outcomes, "none": [], "two effects": [each for each in outcomes if len(each.true) == 2]}
    return {name: report_of(some, as_json(some)) for name, some in parts.items()}
