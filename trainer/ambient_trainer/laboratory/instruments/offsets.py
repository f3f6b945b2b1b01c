"""A probe's calibration offset is added to its reading; between the temperatures of a calibration it goes straight.

A file of offsets is YAML, as ``ambient-trainer calibrate`` writes it and a campaign's ``offsets`` names it.
"""

from __future__ import annotations

import bisect
import datetime
import itertools
from collections.abc import Mapping
from typing import NamedTuple

import yaml
from pydantic import Field, model_validator

from ambient_trainer.data.strict_yaml import Strict, load_yaml, validated, wrong

FORMAT = "probe-offsets"
VERSION = 1


class ProbeOffset(NamedTuple):
    """The offset of one probe, at the readings that it was calibrated at."""

    points: tuple[tuple[float, float], ...]
    """(reading in degC, offset in K), the readings increasing; beyond them the nearest holds."""

    @staticmethod
    def constant(offset_K: float) -> ProbeOffset:
        """The same offset everywhere."""
        return ProbeOffset(((0.0, offset_K),))

    def at(self, reading_degC: float) -> float:
        """What to add to ``reading_degC``, in K."""
        above = bisect.bisect_left(self.points, (reading_degC,))
        if above == 0:
            return self.points[0][1]
        if above == len(self.points):
            return self.points[-1][1]
        (low_degC, low_K), (high_degC, high_K) = self.points[above - 1 : above + 1]
        return low_K + (high_K - low_K) * (reading_degC - low_degC) / (high_degC - low_degC)


class ProbePoint(Strict):
    """One probe at one temperature of the bath."""

    reading_degC: float
    """The mean of what the probe read."""
    offset_K: float
    """What is to be added to it."""
    standard_error_K: float = Field(ge=0.0)
    """Of the offset; the reference's own error is not in it."""


class ProbeTable(Strict):
    """One probe at all of them."""

    points: tuple[ProbePoint, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _increasing(self) -> ProbeTable:
        readings = [point.reading_degC for point in self.points]
        if any(one >= other for one, other in itertools.pairwise(readings)):
            raise wrong("the readings do not increase", "sort the points, and drop doubles")
        return self


class OffsetFile(Strict):
    """A file of offsets."""

    format: str
    version: int
    created: datetime.datetime
    reference: str
    """What the probes were compared with."""
    probes: dict[str, ProbeTable] = Field(min_length=1)

    @model_validator(mode="after")
    def _known(self) -> OffsetFile:
        if (self.format, self.version) != (FORMAT, VERSION):
            raise wrong(
                f"format {self.format!r}, version {self.version}",
                f"'calibrate' writes format {FORMAT!r}, version {VERSION}",
            )
        return self


def load_offsets(path: str) -> dict[str, ProbeOffset]:
    """The offsets in the file at ``path`` by probe; raises :class:`~ambient_model.faults.Refused` with every fault."""
    parsed = validated(OffsetFile, load_yaml(path), path)
    return {
        name: ProbeOffset(tuple((point.reading_degC, point.offset_K) for point in table.points))
        for name, table in parsed.probes.items()
    }


def offsets_text(probes: Mapping[str, ProbeTable], reference: str, created: datetime.datetime) -> str:
    """The file that :func:`load_offsets` reads; tenths of a millikelvin are more than any thermocouple is worth."""
    data = {
        "format": FORMAT,
        "version": VERSION,
        "created": created.isoformat(timespec="seconds"),
        "reference": reference,
        "probes": {
            name: {"points": [{key: round(value, 4) for key, value in point} for point in table.points]}
            for name, table in probes.items()
        },
    }
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
