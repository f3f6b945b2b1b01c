"""Units as a page writes them."""

_WRITTEN = {"degC": "°C", "frac": "fraction", "on": "0 or 1"}


def written(unit: str) -> str:
    """``unit``, as it stands in a column's name, for people: ``W_m2`` is ``W/m²``."""
    return _WRITTEN.get(unit, unit.replace("m3_", "m³_").replace("_m2", "_m²").replace("_", "/"))
