"""One sensor reads with a wrong slope."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.candidate import (
    Candidate,
    CauseKind,
    Estimate,
    Parameters,
    Setting,
    Span,
    first_coefficient,
)
from ambient_trainer.diagnosis.causes._sensor import faulty, reads

_ABOUT_DEGC = 25.0
_MOST = 0.9


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """Every sensor: what it reads is off by a share of the temperature over 25 degC, and by a constant."""
    for sensor, name in setting.working_sensors():
        terms = reads(sensor, lambda reading: reading - _ABOUT_DEGC, np.ones_like)
        magnitude = first_coefficient("1", f"relative error of {name}'s slope")
        candidate = faulty("sensor_gain", sensor, name, Span.WINDOW, terms, magnitude, fixed=(None, None))
        yield replace(candidate, parameters=_parameters, plausible=lambda values: np.abs(values[..., 0]) < _MOST)


def _parameters(estimate: Estimate) -> Parameters:
    error, bias = map(float, estimate.values)
    return {"gain": (1.0 + error, "1"), "bias_at_25_degC": (bias, "degC")}


KIND = CauseKind("sensor_gain", "a sensor with a wrong gain", "{place} reads with a wrong slope", _candidates, rank=71)
