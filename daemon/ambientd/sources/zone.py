"""A thermal zone, identified by its type: its number changes from boot to boot."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import first_line, numbered, offered
from ambientd.sources.quantities import Conversion, degC_from_millidegrees
from ambientd.sources.spec import NoteFault, read_texts

if TYPE_CHECKING:
    from ambientd.settings import Settings

FORM = "{zone: TYPE}"


class Zone(NamedTuple):
    """The temperature of the thermal zone of a type.

    ``zones_by_name`` is a folder with links from types to zones, as Android keeps one. A link is followed only where it
    leads to a zone of the type under the root; else all zones are searched.
    """

    type: str

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return "degC"

    @property
    def absent(self) -> str:
        """The message where it is not found."""
        return f"no thermal zone of type '{self.type}'"

    def __str__(self) -> str:
        return f"zone {self.type}"

    def find(self, settings: "Settings") -> list[str]:
        """The paths of the attributes with its name, the one to read first."""
        linked = self._linked(settings)
        folders = [linked] if linked else find_zones(settings.sysfs_root).get(self.type, [])
        return [os.path.join(folder, "temp") for folder in folders]

    def _linked(self, settings: "Settings") -> str:
        if "/" in self.type or not self.type.isprintable():
            return ""  # no name of a file
        folder = os.path.realpath(os.path.join(settings.zones_by_name, self.type))
        inside = folder.startswith(os.path.join(os.path.realpath(settings.sysfs_root), ""))
        return folder if inside and first_line(os.path.join(folder, "type")) == self.type else ""

    def conversion(self, path: str) -> Conversion:
        """From the attribute's bytes to its value."""
        return degC_from_millidegrees

    def hint(self, settings: "Settings") -> str:
        """What to name instead, of what is here."""
        return offered("types here", find_zones(settings.sysfs_root), "'zones' in a configuration")


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
