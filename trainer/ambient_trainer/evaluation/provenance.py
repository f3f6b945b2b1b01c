"""The provenance in a model file: the traces that it was trained on, and the baseline that was fitted beside it."""

import math
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_trainer.data.strict_yaml import Strict, validated
from ambient_trainer.data.trace import Array, Trace, sha256_of
from ambient_trainer.estimators.base import STATIC_LINEAR


class TrainingSpan(Strict, extra="ignore"):
    """A part of a trace that a model was trained on: from_s <= time_s < to_s, open where there is none."""

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
        start = "its start" if self.from_s is None else f"{self.from_s:.10g} s"
        stop = "its end" if self.to_s is None else f"{self.to_s:.10g} s"
        return f"{self.trace}, {start} to {stop}"


class StaticLinear(Strict, extra="ignore"):
    """The static baseline: ambient = sum of gain x input + offset."""

    gains: dict[str, float]
    offset: float


_OF_THIS_KIND = BeforeValidator(lambda it: it if isinstance(it, dict) and it.get("kind") == STATIC_LINEAR else None)


class Provenance(Strict, extra="ignore"):
    """What a model was trained on, and the static linear baseline; None where the file has none or another kind."""

    training: tuple[TrainingSpan, ...] = ()
    baseline: Annotated[StaticLinear | None, _OF_THIS_KIND] = None


class _File(Strict):
    provenance: Provenance


def provenance_of(model: Model) -> Provenance:
    """The provenance in the model file; raises :class:`Refused` for other forms.

    So it does for a baseline that cannot be computed from the model's inputs.
    """
    found = validated(_File, {"provenance": dict(model.provenance)}, f"model {model.name}").provenance
    inputs = [each.name for each in model.main.inputs]
    if found.baseline and (strangers := found.baseline.gains.keys() - set(inputs)):
        problem, hint = f"{', '.join(strangers)}: no input of the model", f"inputs are {', '.join(inputs)}"
        raise refuse(f"model {model.name}", "provenance.baseline.gains", problem, hint)
    return found


def overlaps_training(model: Model, trace: Trace) -> bool:
    """Whether the file of ``trace`` (which may be cut) was trained on, at any of its times."""
    sha256 = trace.sha256 or sha256_of(trace.path)
    spans = provenance_of(model).training
    return any(span.sha256.lower() == sha256 and span.holds_any(trace.time_s) for span in spans)
