"""The constants that calibration finds: a data file with value, unit, start, bounds and role of each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from ambient_trainer.data.strict_yaml import Strict, load_yaml, validated, wrong

SHIPPED = Path(__file__).with_name("phone.yaml")


class Constant(Strict):
    """One constant; ``start`` is the engineer's guess that a calibration begins with and is drawn to."""

    value: Annotated[float, Field(gt=0)]
    unit: str
    start: Annotated[float, Field(gt=0)]
    low: Annotated[float, Field(gt=0)]
    high: Annotated[float, Field(gt=0)]
    role: str

    @model_validator(mode="after")
    def _inside(self) -> Constant:
        if not (self.low <= self.start <= self.high and self.low <= self.value <= self.high):
            raise wrong("start or value lies outside low to high", "widen the bounds or move it")
        return self


class _File(Strict):
    constants: dict[str, Constant]


def load_constants(path: str | Path = SHIPPED) -> dict[str, Constant]:
    """The constants by name, such as ``capacitance_J_K.battery``; raises :class:`~ambient_model.faults.Refused`."""
    return validated(_File, {"constants": load_yaml(str(path))}, Path(path).name).constants


@cache
def shipped_values() -> Mapping[str, float]:
    """The shipped value of every calibrated constant, by name."""
    return {name: constant.value for name, constant in load_constants().items()}


def rounded(value: float) -> float:
    """``value`` to the digits that a constants file holds."""
    return float(f"{value:.4g}")


def constants_text(constants: Mapping[str, Constant], values: Mapping[str, float]) -> str:
    """The content of a constants file with new ``values``."""
    lines = [
        "# Calibrated to the thesis's published figures; `value` is written by `ambient-trainer calibrate-phone`.\n",
        "# Thermal figures tell heat flows up to a common factor: the guesses set it, by the phone's mass.\n",
    ]
    for name, each in constants.items():
        unit, role = json.dumps(each.unit), json.dumps(each.role)
        lines.append(
            f"{name}: {{value: {rounded(values[name]):g}, unit: {unit}, start: {each.start:g}, low: {each.low:g}, "
            f"high: {each.high:g}, role: {role}}}\n"
        )
    return "".join(lines)
