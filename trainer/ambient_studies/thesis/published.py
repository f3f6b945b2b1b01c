"""What the thesis published: parameters (tables 4.1 to 4.8) and errors (tables 5.1 to 5.12), with what they imply."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

import yaml

from ambient_model.model import LEVELS_PERCENT, Quantiles

MODELS = {
    "model1_kirchhoff": "Model 1 Kirchhoff",
    "model1_ss": "Model 1 state-space",
    "model1_ss_single_input": "Model 1 state-space single input",
    "model2_ss": "Model 2 state-space",
    "model2_ss_single_input": "Model 2 state-space single input",
    "model2_ss_free_cd": "Model 2 state-space random C & D",
    "linear_battery": "Linear battery",
    "linear_usb": "Linear USB",
    "linear_flash": "Linear flash",
    "linear_combined": "Linear combined",
}
"""Circuit names and the thesis's own, in the order of its tables."""

NONCAUSAL = "model1_ss_single_input"
"""Its published errors can only come from an estimate that used the reference (erratum 9)."""

CONSTANT_SCENARIOS = ("1", "2.1", "2.3", "2.4")
"""At 20 degC; the statistics of the raw sensors can be recovered for these."""


@dataclass(frozen=True)
class Parameters:
    """One model's parameters in the units of its circuit file: as printed, and with the values of the errata."""

    table: str
    printed: Mapping[str, float]
    corrected: Mapping[str, float]


@dataclass(frozen=True)
class Result:
    """A model's errors (true minus estimate) over a scenario, in degC; ``interval_degC`` is by level in percent."""

    rmse_degC: float
    mae_degC: float
    mbe_degC: float
    interval_degC: Quantiles


@dataclass(frozen=True)
class SensorStatistics:
    """A raw sensor over a scenario at 20 degC, recovered from published errors; the display's deviation is unknown."""

    mean_degC: float
    std_degC: float | None


Results = Mapping[tuple[str, str], Result]
"""By scenario and model."""


@cache
def published_parameters() -> Mapping[str, Parameters]:
    """Tables 4.1 to 4.8 by model, in the order of the thesis."""
    models = yaml.safe_load(_text("parameters.yaml"))["models"]
    return {
        name: Parameters(each["table"], each["printed"], {**each["printed"], **each.get("corrected", {})})
        for name, each in models.items()
    }


@cache
def published_results() -> Results:
    """Tables 5.1 to 5.12."""
    found = {}
    for row in _rows("results.csv"):
        bands = {each: (float(row[f"ci{each}_low_degC"]), float(row[f"ci{each}_high_degC"])) for each in LEVELS_PERCENT}
        rmse, mae, mbe = (float(row[f"{name}_degC"]) for name in ("rmse", "mae", "mbe"))
        found[row["scenario"], row["model"]] = Result(rmse, mae, mbe, bands)
    return found


@cache
def sensor_statistics() -> Mapping[tuple[str, str], SensorStatistics]:
    """Battery, USB, flash and display by constant scenario and sensor."""
    rows = [*_rows("sensor_statistics.csv"), *({**row, "sensor": "display"} for row in _rows("display_mean.csv"))]
    return {
        (row["scenario"], row["sensor"]): SensorStatistics(
            float(row["mean_degC"]), float(row["std_degC"]) if "std_degC" in row else None
        )
        for row in rows
    }


def _rows(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader(_text(name).splitlines()))


def _text(name: str) -> str:
    return (resources.files(__package__) / name).read_text()
