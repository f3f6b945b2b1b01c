"""What the kernel says in whole numbers becomes degC, A and V here and nowhere else; what is no number is missing."""

BUFFER_BYTES = 32
"""More than any attribute that holds one number; what fills it holds something else."""
_ABSOLUTE_ZERO_DEGC = -273.15
"""Drivers say -274000 or -32768000 for a sensor that has nothing to say."""


def degC_from_millidegrees(content: bytes) -> float | None:
    """The temperature in the bytes of a thermal zone's or hwmon's attribute, or None where they hold none."""
    return _degC(content, 1000)


def degC_from_tenths(content: bytes) -> float | None:
    """The temperature in the bytes of a power supply's ``temp``, or None where they hold none."""
    return _degC(content, 10)


def from_micro(content: bytes) -> float | None:
    """The current in A or the voltage in V in the bytes of a power supply's attribute, or None."""
    micro = _integer(content)
    return None if micro is None else micro / 1_000_000


def _degC(content: bytes, steps_per_degC: int) -> float | None:
    steps = _integer(content)
    if steps is None or steps / steps_per_degC < _ABSOLUTE_ZERO_DEGC:
        return None
    return steps / steps_per_degC


def _integer(content: bytes) -> int | None:
    digits = content.strip()
    if len(content) >= BUFFER_BYTES or not digits.removeprefix(b"-").isdigit():
        return None
    return int(digits)
