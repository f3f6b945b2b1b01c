"""A probe's calibration offset is added to its reading; between the temperatures of a calibration it is interpolated.

A file of offsets is YAML, as ``ambient-trainer calibrate`` writes it and a campaign's ``offsets`` names it.
"""

import datetime
import itertools
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import Field

from ambient_trainer.data.strict_yaml import Strict, holds, load_yaml, validated


class OffsetPoint(Strict):
    """One probe at one temperature of the bath; the standard error is without the reference's own error."""

    reading_degC: float
    offset_K: float
    standard_error_K: float = Field(ge=0.0)


_INCREASING = holds(
    lambda points: all(one.reading_degC < other.reading_degC for one, other in itertools.pairwise(points)),
    "the readings do not increase",
    "sort the points, and drop doubles",
)


class ProbeOffset(Strict):
    """The offset of one probe at all temperatures of its calibration; beyond them the nearest holds."""

    points: Annotated[tuple[OffsetPoint, ...], Field(min_length=1), _INCREASING]

    def at(self, reading_degC: float) -> float:
        """What to add to ``reading_degC``, in K."""
        readings_degC, offsets_K = zip(*((point.reading_degC, point.offset_K) for point in self.points))
        return float(np.interp(reading_degC, readings_degC, offsets_K))

    def __str__(self) -> str:
        return ", ".join(f"{point.offset_K:+.3f} K at {point.reading_degC:g} degC" for point in self.points)


class OffsetFile(Strict):
    """A file of offsets; ``reference`` is what the probes were compared with."""

    format: Literal["probe-offsets"]
    version: Literal[1]
    created: datetime.datetime
    reference: str
    probes: dict[str, ProbeOffset] = Field(min_length=1)


def load_offsets(path: str) -> dict[str, ProbeOffset]:
    """The offsets in the file at ``path`` by probe; raises :class:`~ambient_model.faults.Refused` with every fault."""
    return dict(validated(OffsetFile, load_yaml(path), path).probes)


def offsets_text(probes: Mapping[str, ProbeOffset], reference: str, created: datetime.datetime) -> str:
    """The file that :func:`load_offsets` reads; tenths of a millikelvin are more than any thermocouple is worth."""
    points = {name: [{key: round(value, 4) for key, value in each} for each in probes[name].points] for name in probes}
    head = {"format": "probe-offsets", "version": 1, "created": created.isoformat(timespec="seconds")}
    data = {**head, "reference": reference, "probes": {name: {"points": each} for name, each in points.items()}}
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
