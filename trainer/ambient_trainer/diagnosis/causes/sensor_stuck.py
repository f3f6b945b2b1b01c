"""One sensor always reads the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Setting, Span, first_coefficient
from ambient_trainer.diagnosis.causes._sensor import faulty, reads


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """Each sensor that stood still, while it did."""
    for sensor, (name, window) in enumerate(zip(setting.plant.sensors, setting.flat)):
        if window is not None:
            terms = reads(sensor, np.ones_like, lambda reading: -reading)
            magnitude = first_coefficient("degC", f"what {name} always reads")
            candidate = faulty("sensor_stuck", sensor, name, Span.WINDOW, terms, magnitude, fixed=(None, 1.0))
            yield replace(candidate, window=window)


KIND = CauseKind("sensor_stuck", "a sensor that is stuck", "{place} is stuck", _candidates, rank=72)
