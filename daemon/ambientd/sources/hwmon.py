"""A hwmon temperature, identified by its chip's name and its label: numbers change from boot to boot."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import first_line, numbered
from ambientd.sources.quantities import degC_from_millidegrees
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

    def __str__(self) -> str:
        return f"hwmon {self.chip} {self.label}"

    def source(self, settings: "Settings") -> "HwmonTemperature":
        """The source that reads it."""
        return HwmonTemperature(self, settings.sysfs_root)


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


class HwmonTemperature:
    """The temperature at ``hwmon``, in degC."""

    unit = "degC"

    def __init__(self, hwmon: Hwmon, root: str) -> None:
        self._hwmon = hwmon
        self._root = root
        self.absent = f"no hwmon chip '{hwmon.chip}' with a temperature labelled '{hwmon.label}'"

    def find(self) -> list[str]:
        """The paths of the attributes with its name, the one to read first."""
        return find_hwmon(self._root).get(self._hwmon, [])

    def value(self, content: bytes) -> float | None:
        """The temperature in degC, or None."""
        return degC_from_millidegrees(content)

    def hint(self) -> str:
        """What to name instead, of what is here."""
        names = sorted(f"{{hwmon: {chip}, label: {label}}}" for chip, label in find_hwmon(self._root))
        return f"temperatures here are {', '.join(names) or 'none'}: name one of them under 'sensors'"
