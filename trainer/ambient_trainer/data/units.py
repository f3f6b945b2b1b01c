"""Conversion of millidegrees, tenths, microamperes and Fahrenheit to the trace's own units, done here only."""

from typing import TypeVar

from ambient_model.trace import split_column
from ambient_trainer.data.trace import Array

_Value = TypeVar("_Value", float, Array)
_SAME = (1, 1, 0)
_UNITS: dict[str, dict[str, tuple[float, float, float]]] = {
    "degC": {
        **{"degC": _SAME, "ddegC": (1, 10, 0), "cdegC": (1, 100, 0), "mdegC": (1, 1000, 0)},
        **{"degF": (5, 9, -160 / 9), "K": (1, 1, -273.15)},
    },
    "W": {"W": _SAME, "mW": (1, 1e3, 0), "uW": (1, 1e6, 0), "kW": (1e3, 1, 0)},
    "A": {"A": _SAME, "mA": (1, 1e3, 0), "uA": (1, 1e6, 0)},
    "V": {"V": _SAME, "mV": (1, 1e3, 0), "uV": (1, 1e6, 0)},
    "frac": {"frac": _SAME, "percent": (1, 100, 0), "permille": (1, 1000, 0)},
    "on": {"on": _SAME},
    "W_m2": {"W_m2": _SAME, "kW_m2": (1e3, 1, 0)},
    "m_s": {"m_s": _SAME, "km_h": (1, 3.6, 0)},
    "Hz": {"Hz": _SAME, "kHz": (1e3, 1, 0), "MHz": (1e6, 1, 0), "GHz": (1e9, 1, 0)},
}
"""By the trace's unit those that convert to it: value * multiplier / divisor + offset."""
_WRITTEN = {"degC": "°C", "frac": "fraction", "on": "0 or 1"}
BASES = {unit: base for base, units in _UNITS.items() for unit in units}
"""The trace's unit, by the one that converts to it."""


def target_unit(column: str) -> str | None:
    """The base unit that the trace column's name ends with; None where it is not one of the known."""
    return max((base for base in _UNITS if column.endswith(f"_{base}")), key=len, default=None)


def watts_per_unit(column: str) -> float:
    """What one unit of a column of a power is in W: 1000 of ``heater_kW``; 1 of whatever is no power."""
    unit = split_column(column)[1]
    return to_base(1.0, unit) if BASES.get(unit) == "W" else 1.0


def written(unit: str) -> str:
    """``unit``, as it stands in a column's name, for people: ``W_m2`` is ``W/m²``."""
    return _WRITTEN.get(unit, unit.replace("m3_", "m³_").replace("_m2", "_m²").replace("_", "/"))


def to_base(values: _Value, unit: str) -> _Value:
    """``values`` in ``unit`` as values in its base unit; what is not finite stays so."""
    multiplier, divisor, offset = _UNITS[BASES[unit]][unit]
    return values * multiplier / divisor + offset
