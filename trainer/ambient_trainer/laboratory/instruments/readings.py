"""What instruments say, each with when it was asked and when it was answered; a missing value is None."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class ChamberReading(NamedTuple):
    """The chamber's controller."""

    asked_s: float
    """When the question went out, in the clock's seconds, as ``answered_s``."""
    answered_s: float
    """When the whole answer was there."""
    set_degC: float
    """What the controller is after."""
    actual_degC: float
    """What its own sensor says."""
    running: bool
    """Whether it holds the set point; else it is stopped and drifts."""
    alarm: str | None
    """The controller's own words, such as ``07 overtemperature``; None while there is no fault."""


class MultiplexerReading(NamedTuple):
    """One scan of all probes."""

    asked_s: float
    answered_s: float
    temps_degC: Mapping[str, float | None]
    """By the probe's name, its calibration offset added; None where the thermocouple is open."""


class ThermometerReading(NamedTuple):
    """The reference thermometer."""

    asked_s: float
    answered_s: float
    temp_degC: float | None
    """None where the instrument says that it has no value."""
    reason: str | None
    """Why there is none, in the instrument's terms, such as ``no sensor``; None where there is one."""
