"""A hwmon temperature is known by its chip's name and its label: numbers change from boot to boot."""

import os

from ambientd.sources.listing import first_line, numbered
from ambientd.sources.quantities import degC_from_millidegrees
from ambientd.sources.spec import Hwmon


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
        """The paths of the attributes that answer to its name, the one to take first."""
        return find_hwmon(self._root).get(self._hwmon, [])

    def value(self, content: bytes) -> float | None:
        """The temperature in degC, or None."""
        return degC_from_millidegrees(content)

    def mend(self) -> str:
        """What to name instead, of what is here."""
        names = sorted(f"{{hwmon: {chip}, label: {label}}}" for chip, label in find_hwmon(self._root))
        return f"temperatures here are {', '.join(names) or 'none'}: name one of them under 'sensors'"
