"""Where a configuration says that an input is read: one kind of sensor, under the name that outlives a new start."""

from collections.abc import Callable
from typing import Any, NamedTuple

from ambientd.sources.supervision import Rules

_UNITS = {"temp": "degC", "current_now": "A", "voltage_now": "V"}
_KEYS = {
    "zone": ("zone",),
    "hwmon": ("hwmon", "label"),
    "power_supply": ("power_supply", "property", "sign"),
}
_RULE_RANGES = {"stuck_after_s": (60.0, 1e6), "stuck_within_K": (0.0, 1.0), "jump_K_per_s": (0.1, 1e6)}
_FORMS = "{zone: TYPE}, {hwmon: CHIP, label: LABEL} or {power_supply: NAME, property: PROPERTY}"

NoteFault = Callable[[str, str, str], None]
"""Takes the place, the problem and the mend of a fault."""


class Zone(NamedTuple):
    """The thermal zone of a type."""

    type: str

    @property
    def unit(self) -> str:
        """The unit of what it gives."""
        return "degC"

    def __str__(self) -> str:
        return f"zone {self.type}"


class Hwmon(NamedTuple):
    """The temperature with a label on the hwmon chip of a name."""

    chip: str
    label: str

    @property
    def unit(self) -> str:
        """The unit of what it gives."""
        return "degC"

    def __str__(self) -> str:
        return f"hwmon {self.chip} {self.label}"


class PowerSupply(NamedTuple):
    """A property of the power supply of a name; ``sign`` is -1 where this vendor counts a current the other way."""

    supply: str
    attribute: str
    sign: int = 1

    @property
    def unit(self) -> str:
        """The unit of what it gives."""
        return _UNITS[self.attribute]

    def __str__(self) -> str:
        return f"power_supply {self.supply} {self.attribute}"


Location = Zone | Hwmon | PowerSupply


def read_location(place: str, value: Any, fault: NoteFault) -> Location | None:
    """The location that ``value`` says; None where it says none, with every reason told to ``fault``."""
    kinds = [kind for kind in _KEYS if isinstance(value, dict) and kind in value]
    if len(kinds) != 1:
        fault(place, f"is {value!r}", f"one of {_FORMS} is wanted")
        return None
    known = _KEYS[kinds[0]]
    strangers = [key for key in value if key not in known]
    for key in strangers:
        fault(f"{place}.{key}", "unknown key", f"known beside {kinds[0]!r} are {', '.join(known)}")
    texts = [_text(f"{place}.{key}", value.get(key), fault) for key in known if key != "sign"]
    if kinds[0] == "power_supply":
        location = _power_supply(place, value, texts, fault)
        return None if strangers else location
    if strangers or not all(texts):
        return None
    return Zone(texts[0]) if kinds[0] == "zone" else Hwmon(texts[0], texts[1])


def _power_supply(place: str, value: dict[str, Any], texts: list[str], fault: NoteFault) -> Location | None:
    supply, wanted = texts
    sign = value.get("sign", 1)
    if "/" in supply or supply in (".", ".."):
        fault(f"{place}.power_supply", f"is {supply!r}", "the name of a folder in class/power_supply is wanted")
        supply = ""
    if wanted and wanted not in _UNITS:
        fault(f"{place}.property", f"is {wanted!r}", f"one of {', '.join(_UNITS)} is wanted")
        wanted = ""
    if type(sign) is not int or sign not in (1, -1):
        fault(f"{place}.sign", f"is {sign!r}", "1 or -1 is wanted")
        return None
    if "sign" in value and wanted in ("temp", "voltage_now"):
        fault(f"{place}.sign", f"says nothing for {wanted!r}", "only 'current_now' takes it: remove it")
        return None
    return PowerSupply(supply, wanted, sign) if supply and wanted else None


def _text(place: str, value: Any, fault: NoteFault) -> str:
    if isinstance(value, str) and value.strip() == value != "" and value.isprintable():
        return value
    fault(place, "missing" if value is None else f"is {value!r}", "a text is wanted")
    return ""


def read_rules(place: str, value: Any, fault: NoteFault) -> Rules:
    """The rules of supervision that ``value`` says, with everything wrong in it told to ``fault``."""
    if not isinstance(value, dict):
        fault(place, f"is {value!r}", f"a mapping with {', '.join(_RULE_RANGES)} is wanted")
        return Rules()
    rules = Rules()
    for key, each in value.items():
        if key not in _RULE_RANGES:
            fault(f"{place}.{key}", "unknown key", f"known are {', '.join(_RULE_RANGES)}")
            continue
        low, high = _RULE_RANGES[key]
        if isinstance(each, bool) or not isinstance(each, (int, float)) or not low <= each <= high:
            fault(f"{place}.{key}", f"is {each!r}", f"a number between {low:g} and {high:g} is wanted")
        else:
            rules = rules._replace(**{key: float(each)})
    if "stuck_within_K" in value and "stuck_after_s" not in value:
        fault(f"{place}.stuck_within_K", "says nothing alone", "give stuck_after_s, too, or remove it")
    return rules
