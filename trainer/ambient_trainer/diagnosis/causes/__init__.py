"""One module a cause: what it adds to the circuit, and how its size is read. A new cause is one more here."""

from __future__ import annotations

from collections.abc import Iterator

from ambient_trainer.diagnosis.candidate import Candidate, Setting
from ambient_trainer.diagnosis.causes import (
    ambient_coupling,
    clock_offset,
    contact,
    convection_law,
    heat_source,
    path,
    sensor,
    thermal_mass,
)

_MODULES = (heat_source, ambient_coupling, contact, convection_law, thermal_mass, path, sensor, clock_offset)


def all_candidates(setting: Setting) -> Iterator[Candidate]:
    """Every cause at every place that the circuit has, by every signal that was logged."""
    for module in _MODULES:
        yield from module.candidates(setting)
