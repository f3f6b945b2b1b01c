"""What the thesis published, or what can be recovered from it: the targets of the calibration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from ambient_studies.thesis.published import published_results, sensor_statistics

CONSTANT_SCENARIOS = ("1", "2.1", "2.3", "2.4")
"""Those at a constant 20 degC, for which raw sensors' statistics can be recovered."""


@dataclass(frozen=True)
class SensorFigure:
    """A raw sensor's mean and, where it can be recovered, standard deviation over a scenario, in degC."""

    scenario: str
    sensor: str
    mean_degC: float
    std_degC: float | None


class Errors(NamedTuple):
    """A model's errors over a scenario, in degC; an error is true minus estimate."""

    rmse_degC: float
    mae_degC: float
    mbe_degC: float


@cache
def sensor_figures() -> tuple[SensorFigure, ...]:
    """The statistics of four raw sensors in the constant scenarios."""
    known = sensor_statistics().items()
    return tuple(SensorFigure(scenario, sensor, each.mean_degC, each.std_degC) for (scenario, sensor), each in known)


@cache
def published_errors() -> dict[tuple[str, str], Errors]:
    """The errors of tables 5.1 to 5.12 by scenario and model."""
    return {key: Errors(each.rmse_degC, each.mae_degC, each.mbe_degC) for key, each in published_results().items()}
