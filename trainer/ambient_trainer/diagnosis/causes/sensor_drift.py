"""One sensor's error grows."""

from __future__ import annotations

from collections.abc import Iterator

from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Setting, Span, first_coefficient
from ambient_trainer.diagnosis.causes._sensor import drifts, faulty


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """Every sensor, from an onset on."""
    for sensor, name in setting.working_sensors():
        magnitude = first_coefficient("K/h", f"how {name}'s error grows", 3600.0)
        yield faulty("sensor_drift", sensor, name, Span.ONSET, drifts(sensor), magnitude)


KIND = CauseKind("sensor_drift", "a sensor that drifts", "{place} drifts", _candidates, rank=73)
