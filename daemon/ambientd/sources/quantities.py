"""Conversion of the kernel's integers to degC, A and V, here and nowhere else; what is no number is missing."""

import math
from collections.abc import Callable

Conversion = Callable[[bytes], float | None]
"""From an attribute's bytes to its value in its unit; None where they hold none."""
BUFFER_BYTES = 32
"""More than any attribute that holds one number; what fills it holds something else."""
_DECIMALS = frozenset(b"-.0123456789")
_ABSOLUTE_ZERO_DEGC = -273.15
"""Drivers give -274000 or -32768000 for a sensor without a value."""


def degC_from_millidegrees(content: bytes) -> float | None:
    """The temperature in the bytes of a thermal zone's or hwmon's attribute, or None where they hold none."""
    return _in_steps(content, 1000, _ABSOLUTE_ZERO_DEGC)


def degC_from_tenths(content: bytes) -> float | None:
    """The temperature in the bytes of a power supply's ``temp``, or None where they hold none."""
    return _in_steps(content, 10, _ABSOLUTE_ZERO_DEGC)


def degC_from_raw(content: bytes, offset: float, scale: float) -> float | None:
    """The temperature in the bytes of an iio attribute, (number + offset) scale millidegrees, or None."""
    if len(content) >= BUFFER_BYTES or not _DECIMALS.issuperset(content.strip()):
        return None
    try:
        value = (float(content) + offset) * scale / 1000
    except ValueError:
        return None
    return value if _ABSOLUTE_ZERO_DEGC <= value < math.inf else None


def from_micro(content: bytes) -> float | None:
    """The current in A or the voltage in V in the bytes of a power supply's attribute, or None."""
    return _in_steps(content, 1_000_000, -math.inf)


def _in_steps(content: bytes, steps: int, lowest: float) -> float | None:
    """The number in ``content``, of which ``steps`` make a unit; None where it is none, or below ``lowest`` units."""
    digits = content.strip()
    if len(content) >= BUFFER_BYTES or not digits.removeprefix(b"-").isdigit():
        return None
    value = int(digits) / steps
    return value if value >= lowest else None


REFERENCE_RANGE_DEGC = (-90.0, 100.0)
SIGMA_RANGE_DEGC = (0.05, 20.0)
_NUMERALS = frozenset(b"+-.0123456789eE")


def reference_degC(content: bytes, unit: str, sigma_degC: float) -> tuple[float, float]:
    """Value and sigma in degC of a reference file, which holds ``VALUE`` or ``VALUE SIGMA`` in ``unit``.

    ``sigma_degC`` is that of a file that holds none. Raises ValueError, with the reason.
    """
    words = content.split()
    if len(words) not in (1, 2) or len(content) > 2 * BUFFER_BYTES or not all([_NUMERALS.issuperset(w) for w in words]):
        raise ValueError("it holds no 'VALUE' or 'VALUE SIGMA'")
    try:
        numbers = [float(word) / (1000 if unit == "millidegC" else 1) for word in words]
    except ValueError:
        raise ValueError("it holds no 'VALUE' or 'VALUE SIGMA'") from None
    value, sigma = numbers[0], numbers[-1] if len(numbers) == 2 else sigma_degC
    (low, high), (least, most) = REFERENCE_RANGE_DEGC, SIGMA_RANGE_DEGC
    if not low <= value <= high:
        raise ValueError(f"{value:g} degC is not between {low:g} and {high:g}: is its unit right?")
    if not 0 < sigma <= most:
        raise ValueError(f"sigma {sigma:g} degC is not between {least:g} and {most:g}")
    return value, max(sigma, least)
