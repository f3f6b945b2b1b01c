"""Where a configuration names an input's sensor: one module a kind, imported when that kind is asked for.

A new kind is one new module ``ambientd/sources/KIND.py``; ``sensors: {INPUT: {KIND: ...}}`` then reads from it. It has
``location(place, value, fault)``, which returns the :class:`Location` of the mapping ``value``, or None with every
reason given to ``fault``, and ``FORM``, that mapping as messages show it.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from ambientd.kinds import known, module_of
from ambientd.sources.quantities import Conversion
from ambientd.sources.supervision import Rules

if TYPE_CHECKING:
    from ambientd.settings import Settings

_PACKAGE, _FUNCTION = "ambientd.sources", "location"
_MOST_KEYS = 8
_RULE_RANGES = {"stuck_after_s": (60.0, 1e6), "stuck_within_K": (0.0, 1.0), "jump_K_per_s": (0.1, 1e6)}

NoteFault = Callable[[str, str, str], None]
"""Takes the place, the problem and the hint of a fault."""


class Location(Protocol):
    """One sensor, by a name that a reboot does not change; its text names it in messages."""

    @property
    def unit(self) -> str:
        """The unit of its values."""

    @property
    def absent(self) -> str:
        """The message where it is not found."""

    def find(self, settings: "Settings") -> list[str]:
        """The paths of the attributes with its name on the device of ``settings``, the one to read first."""

    def conversion(self, path: str) -> Conversion:
        """From the bytes of the attribute at ``path`` to its value; asked for whenever that is opened."""

    def hint(self, settings: "Settings") -> str:
        """What to name instead, of what is here."""


def read_location(place: str, value: Any, fault: NoteFault) -> Location | None:
    """The location in ``value``; None where there is none, with every reason given to ``fault``."""
    few = isinstance(value, dict) and len(value) <= _MOST_KEYS
    modules = [module for key in (value if few else ()) if (module := module_of(_PACKAGE, key, _FUNCTION))]
    if len(modules) != 1:
        forms = " or ".join(module.FORM for module in known(_PACKAGE, _FUNCTION).values())
        fault(place, f"is {value!r}", f"one of {forms} is wanted")
        return None
    location: Location | None = modules[0].location(place, value, fault)
    return location


def read_texts(place: str, value: dict[str, Any], keys: tuple[str, ...], fault: NoteFault, *more: str) -> list[str]:
    """The texts in ``value`` under ``keys``, empty where one is wrong; ``more`` keys are known beside them."""
    strangers = [key for key in value if key not in (*keys, *more)]
    for key in strangers:
        fault(f"{place}.{key}", "unknown key", f"known are {', '.join((*keys, *more))}")
    texts = [_text(f"{place}.{key}", value.get(key), fault) for key in keys]
    return [""] * len(keys) if strangers else texts


def _text(place: str, value: Any, fault: NoteFault) -> str:
    if isinstance(value, str) and value.strip() == value != "" and value.isprintable():
        return value
    fault(place, "missing" if value is None else f"is {value!r}", "a text is wanted")
    return ""


def read_rules(place: str, value: Any, fault: NoteFault) -> Rules:
    """The rules of supervision in ``value``, with everything wrong in it given to ``fault``."""
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
        fault(f"{place}.stuck_within_K", "has no effect alone", "give stuck_after_s, too, or remove it")
    return rules
