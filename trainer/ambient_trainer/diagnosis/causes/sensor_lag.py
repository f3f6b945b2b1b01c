"""One sensor reads late."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.candidate import DELTA_95, Candidate, CauseKind, Estimate, Setting, Span
from ambient_trainer.diagnosis.causes._sensor import faulty
from ambient_trainer.diagnosis.result import Magnitude
from ambient_trainer.diagnosis.terms import SensorTerm
from ambient_trainer.diagnosis.view import View
from ambient_trainer.lti.lag import lagged

_LONGEST_S = 3600.0
_SHAPES = 6


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """Every sensor behind a first-order lag."""
    fastest = 0.5 * setting.plant.period_s
    for sensor, name in setting.working_sensors():
        for lag_s in np.geomspace(fastest, max(_LONGEST_S, 40 * fastest), _SHAPES):
            yield _late(sensor, name, float(lag_s))


def _late(sensor: int, name: str, lag_s: float) -> Candidate:
    def terms(view: View) -> tuple[SensorTerm, ...]:
        return (SensorTerm(sensor, lambda reading: lagged(reading, lag_s, view.plant.period_s) - reading),)

    def magnitude(estimate: Estimate) -> Magnitude:
        half = DELTA_95 * estimate.deviation(1)
        ends = lag_s * max(0.0, 1.0 - half), lag_s * (1.0 + half)
        return Magnitude(lag_s, "s", f"time constant of a lag of {name}", ends)

    candidate = faulty("sensor_lag", sensor, name, Span.WINDOW, terms, magnitude, fixed=(1.0,))
    return replace(candidate, shape=lag_s, reshaped=lambda shape: _late(sensor, name, shape))


KIND = CauseKind("sensor_lag", "a sensor that lags", "{place} reads late", _candidates, rank=74, built_in=True)
