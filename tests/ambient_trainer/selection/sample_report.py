"""A search of a small synthetic device, as a report."""

from dataclasses import replace
from functools import cache

from ambient_trainer.report import Report
from ambient_trainer.selection.report import report_of

from .conftest import AGAIN, found_in, made_up


@cache
def samples() -> dict[str, Report]:
    found = found_in(made_up(count=750), 1, [AGAIN])
    data = replace(found.data, left_out={"skin_degC": "constant: 25.5 degC all the time"})
    return {
        "search": report_of(replace(found, data=data)),
        "search for sensors only": report_of(replace(found, circuits={}, checks=(), against=None)),
    }
