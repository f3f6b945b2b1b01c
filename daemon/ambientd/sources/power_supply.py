"""A power supply is known by its folder's name; its temperature is in tenths, current and voltage in millionths."""

import os

from ambientd.sources.quantities import degC_from_tenths, from_micro
from ambientd.sources.spec import PowerSupply


class PowerSupplyProperty:
    """The property at ``location``, in degC, A or V; a current with the location's sign."""

    def __init__(self, location: PowerSupply, root: str) -> None:
        self._location = location
        self._folder = os.path.join(root, "class", "power_supply")
        self.unit = location.unit
        self.absent = f"no property '{location.attribute}' of a power supply '{location.supply}'"

    def find(self) -> list[str]:
        """The path of the attribute, if it is there."""
        path = os.path.join(self._folder, self._location.supply, self._location.attribute)
        return [path] if os.path.exists(path) else []

    def value(self, content: bytes) -> float | None:
        """What the attribute says in the property's unit, or None."""
        if self._location.attribute == "temp":
            return degC_from_tenths(content)
        value = from_micro(content)
        return None if value is None else self._location.sign * value + 0.0  # which makes 0 of -0

    def mend(self) -> str:
        """What to name instead, of what is here."""
        try:
            names = sorted(os.listdir(self._folder))
        except OSError:
            names = []
        here = [name for name in names if os.path.exists(os.path.join(self._folder, name, self._location.attribute))]
        return f"supplies here with it are {', '.join(here) or 'none'}: name one of them under 'sensors'"
