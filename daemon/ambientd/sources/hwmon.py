"""A hwmon temperature, identified by its chip's name and its label: numbers change from boot to boot."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import first_line, numbered, offered
from ambientd.sources.quantities import Conversion, degC_from_millidegrees
from ambientd.sources.spec import NoteFault, read_texts

if TYPE_CHECKING:
    from ambientd.settings import Settings

FORM = "{hwmon: CHIP, label: LABEL}"


class Hwmon(NamedTuple):
    """The temperature with a label on the hwmon chip of a name."""

    chip: str
    label: str

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return "degC"

    @property
    def absent(self) -> str:
        """The message where it is not found."""
        return f"no hwmon chip '{self.chip}' with a temperature labelled '{self.label}'"

    def __str__(self) -> str:
        return f"hwmon {self.chip} {self.label}"

    def find(self, settings: "Settings") -> list[str]:
        """The paths of the attributes with its name, the one to read first."""
        return find_hwmon(settings.sysfs_root).get(self, [])

    def conversion(self, path: str) -> Conversion:
        """From the attribute's bytes to its value."""
        return degC_from_millidegrees

    def hint(self, settings: "Settings") -> str:
        """What to name instead, of what is here."""
        found = find_hwmon(settings.sysfs_root)
        return offered("temperatures here", [f"{{hwmon: {chip}, label: {label}}}" for chip, label in found])


def location(place: str, value: dict[str, Any], fault: NoteFault) -> Hwmon | None:
    """The temperature that a configuration names."""
    chip, label = read_texts(place, value, ("hwmon", "label"), fault)
    return Hwmon(chip, label) if chip and label else None


def find_hwmon(root: str) -> dict[tuple[str, str], list[str]]:
    """The paths of the temperatures under ``root`` per chip and label, in the order of their numbers.

    A temperature without a label goes by the name of its attribute: ``temp1``.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for folder in numbered(os.path.join(root, "class", "hwmon"), "hwmon", ""):
        chip = first_line(os.path.join(folder, "name"))
        for path in numbered(folder, "temp", "_input"):
            stem = path.removesuffix("_input")
            label = first_line(f"{stem}_label") or os.path.basename(stem)
            if chip:
                found.setdefault((chip, label), []).append(path)
    return found
