"""Methods with known errors over short runs, and published figures to hold against them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ambient_studies.reproduce.names import MODELS, OURS, RELATED, TABLES
from ambient_studies.reproduce.reproduction import Reproduction, reproduce
from ambient_studies.reproduce.rows import Results
from ambient_studies.reproduce.runs import EVALUATED
from ambient_studies.thesis.published import Result
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.method import Method


def quiet(what: str, done: int, total: int) -> None:
    """A progress that shows nothing."""


def run_of(scenario: str, samples: int = 60) -> Trace:
    """Sensors that rise over a constant ambient of 20 degC."""
    time_s = np.arange(samples) * 1.0
    sensors = {
        f"{name}_degC": 21.0 + time_s / 60 * k
        for k, name in enumerate(("usb", "display", "battery", "flash", "soc"), start=1)
    }
    return Trace(f"scenario {scenario}", time_s, {**sensors, "ambient_degC": np.full(samples, 20.0)})


def off_by(name: str, error_degC: float, variant: str = "corrected") -> Method:
    """A method whose error is ``error_degC`` everywhere but in the second half, where it is zero."""

    def estimate(trace: Trace) -> np.ndarray:
        half = len(trace.time_s) // 2
        return 20.0 - error_degC * (np.arange(len(trace.time_s)) < half)

    return Method(name, variant, estimate, f"{name}, made up")  # type: ignore[arg-type]


def result(rmse_degC: float) -> Result:
    """Published figures of that RMSE."""
    bands = dict.fromkeys((50, 90, 98), (-rmse_degC, rmse_degC))
    return Result(rmse_degC, 0.8 * rmse_degC, 0.1 * rmse_degC, bands)


def all_off() -> list[Method]:
    """The ten models and the related methods, each worse than the one before, ours, and one that saw the reference."""
    found = [off_by(name, 0.1 * (index + 1)) for index, name in enumerate((*MODELS, *RELATED))]
    ours = [off_by(name, 0.02, "ours") for name in OURS]
    return [*found, *ours, off_by("model1_ss_single_input", 0.05, "noncausal")]


def published_as_made() -> Results:
    """Figures in the order in which :func:`all_off` errs."""
    return {(scenario, name): result(0.1 * (index + 1)) for scenario in TABLES for index, name in enumerate(MODELS)}


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Reproduction]:
    """A reproduction with made-up methods over made-up runs."""
    from ambient_studies.reproduce import reproduction
    from ambient_studies.reproduce.runs import Runs

    def runs(seed: int, progress: object) -> Runs:
        return Runs(run_of("5"), run_of("1"), {name: run_of(name) for name in EVALUATED})

    monkeypatch.setattr(reproduction, "simulated_runs", runs)
    return lambda: reproduce(3, lambda runs, progress: all_off(), published_as_made(), quiet)


@pytest.fixture
def method_off_by() -> Callable[..., Method]:
    return off_by


@pytest.fixture
def run() -> Callable[..., Trace]:
    return run_of


@pytest.fixture
def published_result() -> Callable[[float], Result]:
    return result
