"""A property of a power supply, identified by its folder's name: temperature, current or voltage."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import offered
from ambientd.sources.quantities import Conversion, degC_from_tenths, from_micro
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

    @property
    def absent(self) -> str:
        """The message where it is not found."""
        return f"no property '{self.attribute}' of a power supply '{self.supply}'"

    def __str__(self) -> str:
        return f"power_supply {self.supply} {self.attribute}"

    def find(self, settings: "Settings") -> list[str]:
        """The path of the attribute, if it is there."""
        path = os.path.join(_folder(settings), self.supply, self.attribute)
        return [path] if os.path.exists(path) else []

    def conversion(self, path: str) -> Conversion:
        """From the attribute's bytes to its value."""
        return degC_from_tenths if self.attribute == "temp" else self._signed

    def _signed(self, content: bytes) -> float | None:
        value = from_micro(content)
        return None if value is None else self.sign * value + 0.0  # which makes 0 of -0

    def hint(self, settings: "Settings") -> str:
        """What to name instead, of what is here."""
        try:
            names = os.listdir(_folder(settings))
        except OSError:
            names = []
        return offered("supplies here with it", [name for name in names if self._replace(supply=name).find(settings)])


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


def _folder(settings: "Settings") -> str:
    return os.path.join(settings.sysfs_root, "class", "power_supply")
