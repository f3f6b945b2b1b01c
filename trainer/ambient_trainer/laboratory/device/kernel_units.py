"""Millidegrees, tenths, microamperes and microvolts of a kernel become degC, A and V here, once."""

from __future__ import annotations

from ambient_trainer.laboratory.campaign import Device

PLAUSIBLE_DEGC = (-60.0, 250.0)
"""Beyond them a reading stands for no reading, such as -274000 or -32768000."""
_PER_UNIT = {"temp": 10.0, "current_now": 1e6, "voltage_now": 1e6}


def degrees_from_millidegrees(text: str) -> float | None:
    """What a thermal zone's ``temp`` holds, in degC; None for what is no temperature."""
    return _plausible(_quotient(text, 1000.0))


def supply_value(attribute: str, text: str, device: Device) -> float | None:
    """What an attribute of the power supply holds, in degC, A (positive into the battery) or V; None for nothing."""
    value = _quotient(text, _PER_UNIT[attribute])
    if attribute == "temp":
        return _plausible(value)
    supply = device.power_supply
    reverse = attribute == "current_now" and supply is not None and supply.charging_is == "negative"
    return -value + 0.0 if reverse and value is not None else value


def _quotient(text: str, per_unit: float) -> float | None:
    try:
        return int(text) / per_unit
    except ValueError:
        return None


def _plausible(temp_degC: float | None) -> float | None:
    low_degC, high_degC = PLAUSIBLE_DEGC
    return temp_degC if temp_degC is not None and low_degC <= temp_degC <= high_degC else None
