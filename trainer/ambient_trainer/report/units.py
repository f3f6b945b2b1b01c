"""Units as a page writes them."""

from __future__ import annotations

import re

_WRITTEN = {"degC": "°C", "W_m2": "W/m²", "m_s": "m/s", "frac": "fraction", "on": "0 or 1"}


def written(unit: str) -> str:
    """``unit``, as it stands in a column's name, for people: ``W_m2`` is ``W/m²``."""
    return _WRITTEN.get(unit, unit)


def with_degrees(text: str) -> str:
    """``text`` with °C for degC, but in a column's name such as ``usb_degC``."""
    return re.sub(r"(?<!\w)degC\b", "°C", text)
