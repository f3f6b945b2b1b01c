"""What the thesis published of its results (tables 5.1 to 5.12), and what its errors tell of the raw sensors."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

from ambient_model.model import LEVELS_PERCENT, Quantiles


@dataclass(frozen=True)
class Result:
    """A model's errors (true minus estimate) over a scenario, in degC; ``interval_degC`` is by level in percent."""

    rmse_degC: float
    mae_degC: float
    mbe_degC: float
    interval_degC: Quantiles


@dataclass(frozen=True)
class SensorStatistics:
    """A raw sensor over a scenario at 20 degC, recovered from published errors; the display's spread is not known."""

    mean_degC: float
    std_degC: float | None


@cache
def published_results() -> Mapping[tuple[str, str], Result]:
    """The errors by scenario and model."""
    return {(row["scenario"], row["model"]): _result(row) for row in _rows("results.csv")}


@cache
def sensor_statistics() -> Mapping[tuple[str, str], SensorStatistics]:
    """Battery, USB, flash and display by scenario (1, 2.1, 2.3, 2.4) and sensor."""
    known = {
        (row["scenario"], row["sensor"]): SensorStatistics(float(row["mean_degC"]), float(row["std_degC"]))
        for row in _rows("sensor_statistics.csv")
    }
    display = {
        (row["scenario"], "display"): SensorStatistics(float(row["mean_degC"]), None)
        for row in _rows("display_mean.csv")
    }
    return {**known, **display}


def _result(row: Mapping[str, str]) -> Result:
    bands = {level: (float(row[f"ci{level}_low_degC"]), float(row[f"ci{level}_high_degC"])) for level in LEVELS_PERCENT}
    return Result(float(row["rmse_degC"]), float(row["mae_degC"]), float(row["mbe_degC"]), bands)


def _rows(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((resources.files(__package__) / name).read_text().splitlines()))
