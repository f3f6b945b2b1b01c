"""A temperature of an iio device, as on a Sense HAT or Enviro+, identified by the device's name and its channel.

The kernel gives it in millidegrees as ``CHANNEL_input``, or as ``CHANNEL_raw`` with ``CHANNEL_offset`` and
``CHANNEL_scale`` beside it, or ``in_temp_offset`` and ``in_temp_scale`` for all of the device's temperatures
(Documentation/ABI/testing/sysfs-bus-iio).
"""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from ambientd.sources.listing import first_line, numbered, offered
from ambientd.sources.quantities import Conversion, degC_from_raw
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

    @property
    def absent(self) -> str:
        """The message where it is not found."""
        return f"no iio device '{self.device}' with a temperature '{self.channel}'"

    def __str__(self) -> str:
        return f"iio {self.device} {self.channel}"

    def find(self, settings: "Settings") -> list[str]:
        """The paths of the attributes with its name, the one to read first."""
        return find_iio(settings.sysfs_root).get(self, [])

    def conversion(self, path: str) -> Conversion:
        """From the attribute's bytes to its value, by the scale that is beside it now."""
        offset, scale = 0.0, 1.0
        if path.endswith("_raw"):
            stem = path.removesuffix("raw")
            offset, scale = _number(stem, "offset", 0), _number(stem, "scale", 1)
        return lambda content: degC_from_raw(content, offset, scale)

    def hint(self, settings: "Settings") -> str:
        """What to name instead, of what is here."""
        found = find_iio(settings.sysfs_root)
        return offered("temperatures here", [f"{{iio: {device}, channel: {channel}}}" for device, channel in found])


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


def _number(stem: str, name: str, usual: float) -> float:
    """The channel's own attribute of that name, or the one that the device's temperatures share; ``usual`` for none."""
    shared = os.path.join(os.path.dirname(stem), f"in_temp_{name}")
    try:
        return float(first_line(stem + name) or first_line(shared) or usual)
    except ValueError:
        return float("nan")  # which makes each value missing
