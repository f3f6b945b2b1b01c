"""What the thesis published: parameters (tables 4.1 to 4.8) and errors (tables 5.1 to 5.12), with what they imply.

Also what tables call methods, variants and scenarios, and which of the thesis's tables holds which scenario.
"""

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

RELATED = {
    "chau_linear_battery": "Chau 2019, linear battery",
    "he_svr": "He et al. 2020, support vectors",
    "ishii_transfer_functions": "Ishii, Nakashima 2017, transfer functions",
    "li_fixed_point": "Li et al. 2020, fixed point",
}

OURS = {"circuit_observer": "Ours: circuit observer", "free_observer": "Ours: free observer"}
"""Neither in the thesis nor in its related work."""

VARIANTS = {
    "corrected": "corrected",
    "as_printed": "as printed",
    "noncausal": "non-causal",
    "published_parameters": "published parameters",
    "ours": "ours",
}

SCENARIOS = {
    "4": "Scenario 4: verification, ambient and CPU load change",
    "1": "Scenario 1: idle at 20 °C",
    "2.1": "Scenario 2.1: all cores loaded at 20 °C",
    "3": "Scenario 3: ambient from -10 to 50 °C",
    "2.3": "Scenario 2.3: camera",
    "2.4": "Scenario 2.4: video over 4G",
    "2.2": "Scenario 2.2: charging",
    "2.5": "Scenario 2.5: all cores loaded at 50 °C",
}
"""In the order of the thesis's tables, which hold no figures of the last two."""

TABLES = {"4": (1, 2), "1": (3, 4), "2.1": (5, 6), "3": (7, 8), "2.3": (9, 10), "2.4": (11, 12)}
"""By scenario the numbers of its tables in chapter 5: errors, and intervals."""

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


def method_name(model: str) -> str:
    """The thesis's name, or the related method's, or ours."""
    return {**MODELS, **RELATED, **OURS}.get(model, model)
