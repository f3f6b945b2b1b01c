"""One sensor reads with a constant bias."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Setting, Span, first_coefficient
from ambient_trainer.diagnosis.causes._sensor import faulty, reads


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """Every sensor, from an onset to an end."""
    for sensor, name in setting.working_sensors():
        magnitude = first_coefficient("degC", f"what {name} reads too much")
        yield faulty("sensor_bias", sensor, name, Span.WINDOW, reads(sensor, np.ones_like), magnitude)


KIND = CauseKind("sensor_bias", "a sensor that is off by a constant", "{place} reads with a bias", _candidates, rank=70)
