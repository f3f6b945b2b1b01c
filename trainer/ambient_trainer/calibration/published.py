"""What the thesis published, or what can be recovered from it: the targets of the calibration."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import NamedTuple

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
    known = [
        SensorFigure(row["scenario"], row["sensor"], float(row["mean_degC"]), float(row["std_degC"]))
        for row in _rows("sensor_statistics.csv")
    ]
    display = [
        SensorFigure(row["scenario"], "display", float(row["mean_degC"]), None) for row in _rows("display_mean.csv")
    ]
    return (*known, *display)


@cache
def published_errors() -> dict[tuple[str, str], Errors]:
    """The errors of tables 5.1 to 5.12 by scenario and model."""
    return {
        (row["scenario"], row["model"]): Errors(float(row["rmse_degC"]), float(row["mae_degC"]), float(row["mbe_degC"]))
        for row in _rows("results.csv")
    }


def _rows(name: str) -> list[dict[str, str]]:
    text = (resources.files("ambient_trainer.thesis") / name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))
