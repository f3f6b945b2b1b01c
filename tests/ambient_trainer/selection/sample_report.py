"""A search of a small synthetic device, as a report."""

from dataclasses import replace
from functools import cache

from ambient_trainer.report import Report
from ambient_trainer.selection.report import report_of
from ambient_trainer.selection.screen import LeftOut

from .conftest import AGAIN, found_in, made_up


@cache
def samples() -> dict[str, Report]:
    found = found_in(made_up(count=750), 1, [AGAIN])
    left_out = (LeftOut("skin_degC", "constant: 25.5 degC all the time"),)
    return {
        "search": report_of(replace(found, left_out=left_out)),
        "search for sensors only": report_of(replace(found, circuits={}, checks=(), against=None)),
    }
