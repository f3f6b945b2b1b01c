"""A property of a power supply, identified by its folder's name: temperature, current or voltage."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.quantities import degC_from_tenths, from_micro
from ambientd.sources.spec import NoteFault, read_texts

if TYPE_CHECKING:
    from ambientd.settings import Settings

FORM = "{power_supply: NAME, property: PROPERTY}"
_UNITS = {"temp": "degC", "current_now": "A", "voltage_now": "V"}


class PowerSupply(NamedTuple):
    """A property of the power supply of a name; ``sign`` is -1 where this vendor counts a current the other way."""

    supply: str
    attribute: str
    sign: int = 1

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return _UNITS[self.attribute]

    def __str__(self) -> str:
        return f"power_supply {self.supply} {self.attribute}"

    def source(self, settings: "Settings") -> "PowerSupplyProperty":
        """The source that reads it."""
        return PowerSupplyProperty(self, settings.sysfs_root)


def location(place: str, value: dict[str, Any], fault: NoteFault) -> PowerSupply | None:
    """The property that a configuration names."""
    supply, attribute = read_texts(place, value, ("power_supply", "property"), fault, "sign")
    sign = value.get("sign", 1)
    if "/" in supply or supply in (".", ".."):
        fault(f"{place}.power_supply", f"is {supply!r}", "the name of a folder in class/power_supply is wanted")
        supply = ""
    if attribute and attribute not in _UNITS:
        fault(f"{place}.property", f"is {attribute!r}", f"one of {', '.join(_UNITS)} is wanted")
        attribute = ""
    if type(sign) is not int or sign not in (1, -1):
        fault(f"{place}.sign", f"is {sign!r}", "1 or -1 is wanted")
        return None
    if "sign" in value and attribute in ("temp", "voltage_now"):
        fault(f"{place}.sign", f"has no effect on {attribute!r}", "only 'current_now' takes it: remove it")
        return None
    return PowerSupply(supply, attribute, sign) if supply and attribute else None


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
        """The value in the property's unit, or None."""
        if self._location.attribute == "temp":
            return degC_from_tenths(content)
        value = from_micro(content)
        return None if value is None else self._location.sign * value + 0.0  # which makes 0 of -0

    def hint(self) -> str:
        """What to name instead, of what is here."""
        try:
            names = sorted(os.listdir(self._folder))
        except OSError:
            names = []
        here = [name for name in names if os.path.exists(os.path.join(self._folder, name, self._location.attribute))]
        return f"supplies here with it are {', '.join(here) or 'none'}: name one of them under 'sensors'"
