"""A thermal zone, identified by its type: its number changes from boot to boot."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import first_line, numbered
from ambientd.sources.quantities import degC_from_millidegrees
from ambientd.sources.spec import NoteFault, read_texts

if TYPE_CHECKING:
    from ambientd.settings import Settings

FORM = "{zone: TYPE}"


class Zone(NamedTuple):
    """The thermal zone of a type."""

    type: str

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return "degC"

    def __str__(self) -> str:
        return f"zone {self.type}"

    def source(self, settings: "Settings") -> "ZoneTemperature":
        """The source that reads it."""
        return ZoneTemperature(self, settings.sysfs_root, settings.zones_by_name)


def location(place: str, value: dict[str, Any], fault: NoteFault) -> Zone | None:
    """The zone that a configuration names."""
    [kind] = read_texts(place, value, ("zone",), fault)
    return Zone(kind) if kind else None


def find_zones(root: str) -> dict[str, list[str]]:
    """The folders of the thermal zones under ``root``, per type and in the order of their numbers."""
    zones: dict[str, list[str]] = {}
    for folder in numbered(os.path.join(root, "class", "thermal"), "thermal_zone", ""):
        kind = first_line(os.path.join(folder, "type"))
        if kind:
            zones.setdefault(kind, []).append(folder)
    return zones


class ZoneTemperature:
    """The temperature of the thermal zone ``zone`` under ``root``, in degC.

    ``by_name`` is a folder with links from types to zones, as Android keeps one. A link is followed only where it
    leads to a zone of the type under ``root``; else all zones are searched.
    """

    unit = "degC"
    value = staticmethod(degC_from_millidegrees)

    def __init__(self, zone: Zone, root: str, by_name: str) -> None:
        self._zone = zone
        self._root = root
        self._by_name = by_name
        self.absent = f"no thermal zone of type '{zone.type}'"

    def find(self) -> list[str]:
        """The paths of the attributes with its name, the one to read first."""
        linked = self._linked()
        folders = [linked] if linked else find_zones(self._root).get(self._zone.type, [])
        return [os.path.join(folder, "temp") for folder in folders]

    def _linked(self) -> str:
        kind = self._zone.type
        if "/" in kind or not kind.isprintable():
            return ""  # no name of a file
        folder = os.path.realpath(os.path.join(self._by_name, kind))
        inside = folder.startswith(os.path.join(os.path.realpath(self._root), ""))
        return folder if inside and first_line(os.path.join(folder, "type")) == kind else ""

    def hint(self) -> str:
        """What to name instead, of what is here."""
        types = ", ".join(sorted(find_zones(self._root))) or "none"
        return f"types here are {types}: name one of them under 'zones' in a configuration"
