"""A reproduction whose methods have known errors, as a report; figures 4.1 and 4.5 are simulated."""

from functools import cache

from ambient_studies.thesis.errata import text_errata
from ambient_studies.thesis.outcome import Outcome
from ambient_studies.thesis.report import report_of
from ambient_trainer.report import Report

from .synthetic import synthetic_reproduction


@cache
def samples() -> dict[str, Report]:
    calibration = [Outcome("1", "usb", "std", 2.0, 1.39)]
    return {"reproduction": report_of(synthetic_reproduction(), text_errata(), calibration)}
