"""Millidegrees, tenths, microamperes and Fahrenheit become the trace's own units here, once."""

from typing import NamedTuple

from ambient_trainer.data.trace import Array


class Unit(NamedTuple):
    """``base value = value * multiplier / divisor + offset``, where the base unit is the trace's."""

    base: str
    multiplier: float = 1.0
    divisor: float = 1.0
    offset: float = 0.0


UNITS = {
    "degC": Unit("degC"),
    "ddegC": Unit("degC", divisor=10),
    "cdegC": Unit("degC", divisor=100),
    "mdegC": Unit("degC", divisor=1000),
    "degF": Unit("degC", 5, 9, -160 / 9),
    "K": Unit("degC", offset=-273.15),
    "W": Unit("W"),
    "mW": Unit("W", divisor=1e3),
    "uW": Unit("W", divisor=1e6),
    "kW": Unit("W", 1e3),
    "A": Unit("A"),
    "mA": Unit("A", divisor=1e3),
    "uA": Unit("A", divisor=1e6),
    "V": Unit("V"),
    "mV": Unit("V", divisor=1e3),
    "uV": Unit("V", divisor=1e6),
    "frac": Unit("frac"),
    "percent": Unit("frac", divisor=100),
    "permille": Unit("frac", divisor=1000),
    "on": Unit("on"),
    "W_m2": Unit("W_m2"),
    "kW_m2": Unit("W_m2", 1e3),
    "m_s": Unit("m_s"),
    "km_h": Unit("m_s", divisor=3.6),
    "Hz": Unit("Hz"),
    "kHz": Unit("Hz", 1e3),
    "MHz": Unit("Hz", 1e6),
    "GHz": Unit("Hz", 1e9),
}


def target_unit(column: str) -> str | None:
    """The base unit that the trace column's name ends with; None where it is not one of the known."""
    bases = {unit.base for unit in UNITS.values()}
    fitting = [base for base in bases if column.endswith(f"_{base}")]
    return max(fitting, key=len, default=None)


def units_of(base: str) -> list[str]:
    """The units that convert to ``base``."""
    return [name for name, unit in UNITS.items() if unit.base == base]


def to_base(values: Array, unit: str) -> Array:
    """``values`` in ``unit`` as values in its base unit; what is not finite stays so."""
    _, multiplier, divisor, offset = UNITS[unit]
    return values * multiplier / divisor + offset
