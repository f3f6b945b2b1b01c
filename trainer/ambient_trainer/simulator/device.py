"""The parameters of a phone and of the chamber it lies in: values that the equations are given, never globals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TypeVar

from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.calibrated import shipped_values

Values = Mapping[str, float]


@dataclass(frozen=True)
class Phone:
    """One unit of the simulated phone; mappings are by node, ``a-b`` of two nodes, or ``activity.node``."""

    capacitance_J_K: Values
    conductance_W_K: Values
    power_W: Values
    """Heat set free in a node while an activity lasts; the SoC's is a demand, which the governor may cut."""
    share: Values
    """By zone: how much of its second node a sensor feels."""
    convection_W_m2_K125: float
    burst_frac: float
    """Standard deviation of the SoC's power while streaming, over its mean."""
    surface_m2: Values = field(default_factory=lambda: c.SURFACE_M2)
    emissivity: float = c.EMISSIVITY
    governor_low_degC: float = c.GOVERNOR_LOW_DEGC
    governor_high_degC: float = c.GOVERNOR_HIGH_DEGC
    governor_floor_frac: float = c.GOVERNOR_FLOOR_FRAC
    battery_V: float = c.BATTERY_V
    battery_ohm: float = c.BATTERY_OHM

    @staticmethod
    def shipped() -> Phone:
        """The calibrated phone."""
        return _shipped()[0]


@dataclass(frozen=True)
class Chamber:
    """The climate chamber's air: the controller's ramp, and its swing about the set point."""

    heating_K_min: float
    cooling_K_min: float
    wobble_degC: float

    @staticmethod
    def shipped() -> Chamber:
        """The calibrated chamber."""
        return _shipped()[1]


_Part = TypeVar("_Part", Phone, Chamber)


def from_values(values: Values) -> tuple[Phone, Chamber]:
    """The phone and chamber that the calibrated constants of these names make, with all the others as they are."""
    phone = Phone(c.CAPACITANCE_J_K, {}, c.POWER_W, {}, 0.0, 0.0)
    in_chamber = {name.partition(".")[2]: value for name, value in values.items() if name.startswith("chamber.")}
    of_phone = {name: value for name, value in values.items() if not name.startswith("chamber.")}
    return with_values(phone, of_phone), Chamber(**in_chamber)


def with_values(part: _Part, values: Values) -> _Part:
    """``part`` with some numbers changed: ``emissivity`` for a field, ``capacitance_J_K.battery`` inside a mapping."""
    changed: dict[str, float | dict[str, float]] = {}
    for name, value in values.items():
        owner, _, key = name.partition(".")
        if key:
            inside = changed.setdefault(owner, dict(getattr(part, owner)))
            assert isinstance(inside, dict)
            inside[key] = value
        else:
            changed[owner] = value
    return replace(part, **changed)  # type: ignore[arg-type]


@cache
def _shipped() -> tuple[Phone, Chamber]:
    return from_values(shipped_values())
