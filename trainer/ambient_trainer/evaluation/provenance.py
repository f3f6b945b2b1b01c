"""The provenance in a model file: the traces that it was trained on, and the baseline that was fitted beside it."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.model import Model
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.estimation.static_linear import STATIC_LINEAR


class TrainingSpan(BaseModel):
    """A part of a trace that a model was trained on: from_s <= time_s < to_s, open where there is none."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    trace: str
    sha256: str
    from_s: float | None = None
    to_s: float | None = None

    def holds_any(self, time_s: Array) -> bool:
        """Whether any of the times (s) lies in it."""
        start = -math.inf if self.from_s is None else self.from_s
        stop = math.inf if self.to_s is None else self.to_s
        return bool(np.any((start <= time_s) & (time_s < stop)))

    def __str__(self) -> str:
        if self.from_s is None and self.to_s is None:
            return f"{self.trace}, whole"
        start = "its start" if self.from_s is None else f"{self.from_s:g} s"
        stop = "its end" if self.to_s is None else f"{self.to_s:g} s"
        return f"{self.trace}, {start} to {stop}"


class StaticLinear(BaseModel):
    """The static baseline: ambient = sum of gain x input + offset."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    kind: Literal["static linear"]
    gains: dict[str, float]
    offset: float


def training_spans(model: Model) -> list[TrainingSpan]:
    """What the model was trained on; empty where its file names nothing. Raises :class:`Refused` for other forms."""
    found: list[TrainingSpan] = _parsed(TypeAdapter(list[TrainingSpan]), model, "training", [])
    return found


def static_linear(model: Model) -> StaticLinear | None:
    """The static linear baseline in the model file; None where it has none or one of another kind.

    Raises :class:`Refused` for one that cannot be computed from the model's inputs.
    """
    content = model.provenance.get("baseline")
    if not isinstance(content, dict) or content.get("kind") != STATIC_LINEAR:
        return None
    found: StaticLinear = _parsed(TypeAdapter(StaticLinear), model, "baseline", None)
    inputs = [each.name for each in model.main.inputs]
    strangers = [name for name in found.gains if name not in inputs]
    if strangers:
        raise refuse(
            f"model {model.name}",
            "provenance.baseline.gains",
            f"{', '.join(strangers)}: no input of the model",
            f"inputs are {', '.join(inputs)}",
        )
    return found


def overlaps_training(model: Model, trace: Trace, sha256: str) -> bool:
    """Whether the file with this digest was trained on, at any of the times of ``trace`` (which may be cut)."""
    return any(span.sha256.lower() == sha256 and span.holds_any(trace.time_s) for span in training_spans(model))


def _parsed(adapter: TypeAdapter[Any], model: Model, key: str, absent: Any) -> Any:
    if key not in model.provenance:
        return absent
    try:
        return adapter.validate_python(model.provenance[key])
    except ValidationError as error:
        faults = [
            Fault(
                ".".join(["provenance", key, *map(str, each["loc"])]),
                each["msg"],
                "export the model again with 'ambient-trainer fit'",
            )
            for each in error.errors()
        ]
        raise Refused(f"model {model.name}", faults) from error
