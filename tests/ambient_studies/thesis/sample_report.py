"""A reproduction whose methods have known errors, as a report; figures 4.1 and 4.5 are simulated."""

from functools import cache

import numpy as np

from ambient_studies.thesis.errata import text_errata
from ambient_studies.thesis.methods import Method, Variant
from ambient_studies.thesis.outcome import Outcome
from ambient_studies.thesis.published import MODELS, NONCAUSAL, OURS, RELATED, TABLES, Result
from ambient_studies.thesis.report import report_of
from ambient_studies.thesis.reproduction import EVALUATED, Reproduction, Runs
from ambient_studies.thesis.rows import evaluate, verdict
from ambient_trainer.data.trace import Trace
from ambient_trainer.report import Report


def run_of(scenario: str, samples: int = 60) -> Trace:
    """Sensors that rise over a constant ambient of 20 degC."""
    time_s = np.arange(samples) * 1.0
    names = ("usb", "display", "battery", "flash", "soc")
    sensors = {f"{name}_degC": 21.0 + time_s / 60 * k for k, name in enumerate(names, start=1)}
    return Trace(f"scenario {scenario}", time_s, {**sensors, "ambient_degC": np.full(samples, 20.0)})


def off_by(name: str, error_degC: float, variant: Variant = "corrected") -> Method:
    """A method whose error is ``error_degC`` in the first half and zero in the second."""

    def estimate(trace: Trace) -> np.ndarray:
        return 20.0 - error_degC * (np.arange(len(trace.time_s)) < len(trace.time_s) // 2)

    return Method(name, variant, estimate, f"{name}, synthetic")


def published_as(rmse_degC: float) -> Result:
    bands = dict.fromkeys((50, 90, 98), (-rmse_degC, rmse_degC))
    return Result(rmse_degC, 0.8 * rmse_degC, 0.1 * rmse_degC, bands)


def synthetic_reproduction() -> Reproduction:
    """Ten models and related methods, each worse than the one before, as published; ours; one that saw the truth."""
    methods = [off_by(name, 0.1 * (index + 1)) for index, name in enumerate((*MODELS, *RELATED))]
    methods += [off_by(name, 0.02, "ours") for name in OURS]
    methods.append(off_by(NONCAUSAL, 0.05, "noncausal"))
    published = {(each, name): published_as(0.1 * (index + 1)) for each in TABLES for index, name in enumerate(MODELS)}
    runs = Runs(run_of("5"), run_of("1"), {name: run_of(name) for name in EVALUATED})
    evaluated = evaluate(methods, runs.evaluated, published, lambda *_: None)
    return Reproduction(3, runs, methods, evaluated, verdict(evaluated.rows))


@cache
def samples() -> dict[str, Report]:
    calibration = [Outcome("1", "usb", "std", 2.0, 1.39)]
    return {"reproduction": report_of(synthetic_reproduction(), text_errata(), calibration)}
