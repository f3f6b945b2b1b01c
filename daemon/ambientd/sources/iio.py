"""A temperature of an iio device, as on a Sense HAT or Enviro+, identified by the device's name and its channel.

The kernel gives it in millidegrees as ``CHANNEL_input``, or as ``CHANNEL_raw`` with ``CHANNEL_offset`` and
``CHANNEL_scale`` beside it (Documentation/ABI/testing/sysfs-bus-iio).
"""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import first_line, numbered
from ambientd.sources.quantities import degC_from_raw
from ambientd.sources.spec import NoteFault, read_texts

if TYPE_CHECKING:
    from ambientd.settings import Settings

FORM = "{iio: DEVICE, channel: CHANNEL}"


class Iio(NamedTuple):
    """A temperature channel, such as ``in_temp`` or ``in_temp_ambient``, of the iio device of a name."""

    device: str
    channel: str

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return "degC"

    def __str__(self) -> str:
        return f"iio {self.device} {self.channel}"

    def source(self, settings: "Settings") -> "IioTemperature":
        """The source that reads it."""
        return IioTemperature(self, settings.sysfs_root)


def location(place: str, value: dict[str, Any], fault: NoteFault) -> Iio | None:
    """The channel that a configuration names."""
    device, channel = read_texts(place, value, ("iio", "channel"), fault)
    return Iio(device, channel) if device and channel else None


def find_iio(root: str) -> dict[Iio, list[str]]:
    """The attributes of the temperatures under ``root`` per device and channel, in the order of the devices' numbers.

    Where a channel has both attributes, it is the one without a scale.
    """
    found: dict[Iio, list[str]] = {}
    for folder in numbered(os.path.join(root, "bus", "iio", "devices"), "iio:device", ""):
        name, channels = first_line(os.path.join(folder, "name")), {}
        for attribute in sorted(_names(folder), reverse=True):
            channel, _, kind = attribute.rpartition("_")
            if channel.startswith("in_temp") and kind in ("raw", "input"):
                channels[channel] = os.path.join(folder, attribute)
        for channel, path in sorted(channels.items()) if name else ():
            found.setdefault(Iio(name, channel), []).append(path)
    return found


def _names(folder: str) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []  # it goes away while it is looked at


class IioTemperature:
    """The temperature of ``channel``, in degC."""

    unit = "degC"

    def __init__(self, channel: Iio, root: str) -> None:
        self._channel = channel
        self._root = root
        self._offset, self._scale = 0.0, 1.0
        self.absent = f"no iio device '{channel.device}' with a temperature '{channel.channel}'"

    def find(self) -> list[str]:
        """The paths of the attributes with its name, the one to read first, whose scale is read here, too."""
        paths = find_iio(self._root).get(self._channel, [])
        self._offset, self._scale = 0.0, 1.0
        if paths and paths[0].endswith("_raw"):
            stem = paths[0].removesuffix("raw")
            self._offset, self._scale = (
                _number(f"{stem}{each}", usual) for each, usual in (("offset", 0), ("scale", 1))
            )
        return paths

    def value(self, content: bytes) -> float | None:
        """The temperature in degC, or None."""
        return degC_from_raw(content, self._offset, self._scale)

    def hint(self) -> str:
        """What to name instead, of what is here."""
        names = [f"{{iio: {device}, channel: {channel}}}" for device, channel in sorted(find_iio(self._root))]
        return f"temperatures here are {', '.join(names) or 'none'}: name one of them under 'sensors'"


def _number(path: str, usual: float) -> float:
    """What the attribute at ``path`` holds; ``usual`` where it is not there, as the kernel's documentation says."""
    try:
        return float(first_line(path) or usual)
    except ValueError:
        return float("nan")  # which makes each value missing
