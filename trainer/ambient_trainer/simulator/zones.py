"""A thermal zone reports what its sensor feels: one node or a mix of two, later, with its own error and rounding."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ambient_trainer.data.strict_yaml import Strict, load_yaml, validated
from ambient_trainer.simulator.constants import NODES

_FILE = Path(__file__).with_name("zones.yaml")

THESIS_ZONES = ("soc", "flash", "battery", "usb", "display")
"""The sensors that the thesis's models read."""


class Zone(Strict):
    """``near`` is the node felt; ``share`` of ``beside`` is mixed in (null: the calibrated share of that name)."""

    name: str
    near: str
    beside: str | None = None
    share: Annotated[float, Field(ge=0, le=1)] | None = None
    lag_s: Annotated[float, Field(gt=0)]
    offset_degC: float = 0.0
    noise_degC: Annotated[float, Field(ge=0)]
    step_degC: Annotated[float, Field(gt=0)]
    """What the reading is rounded to."""


class _Zones(Strict):
    zones: tuple[Zone, ...]


@cache
def all_zones() -> tuple[Zone, ...]:
    """Every zone of the phone, the thesis's five first."""
    return validated(_Zones, load_yaml(str(_FILE)), _FILE.name).zones


def thesis_zones() -> tuple[Zone, ...]:
    """The five zones of the thesis, in its order."""
    named = {zone.name: zone for zone in all_zones()}
    return tuple(named[name] for name in THESIS_ZONES)


def weights(zone: Zone, share: float) -> list[float]:
    """Per node how much of it the zone feels; they sum to one."""
    felt = {zone.near: 1.0}
    if zone.beside is not None:
        felt = {zone.near: 1.0 - share, zone.beside: share}
    return [felt.get(node, 0.0) for node in NODES]
