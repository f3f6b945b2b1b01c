"""Millidegrees of a thermal zone become degC here and nowhere else; what is no temperature is a missing value.

A zone is known by its type: its number changes from boot to boot. Its descriptor is kept open. Where it gives no
value, the zone is looked for again, by type, less and less often.
"""

import os
from collections.abc import Callable, Sequence

from ambientd.notices import Notice

_ABSOLUTE_ZERO_MILLIDEGC = -273150
"""Drivers say -274000 or -32768000 for a sensor that has nothing to say."""
_BUFFER_BYTES = 32
_FIRST_WAIT_S = 1.0
_LONGEST_WAIT_S = 32.0


def temperature_degC(content: bytes) -> float | None:
    """The temperature in the bytes of a ``temp`` file, or None where they hold none."""
    digits = content.strip()
    if len(content) >= _BUFFER_BYTES or not digits.removeprefix(b"-").isdigit():
        return None
    millidegrees = int(digits)
    return millidegrees / 1000 if millidegrees >= _ABSOLUTE_ZERO_MILLIDEGC else None


def find_zones(root: str) -> dict[str, list[str]]:
    """The folders of the thermal zones under ``root``, per type and in the order of their numbers."""
    folder = os.path.join(root, "class", "thermal")
    try:
        names = os.listdir(folder)
    except OSError:
        return {}
    numbers = [name.removeprefix("thermal_zone") for name in names if name.startswith("thermal_zone")]
    zones: dict[str, list[str]] = {}
    for number in sorted((number for number in numbers if number.isascii() and number.isdigit()), key=int):
        zone = os.path.join(folder, f"thermal_zone{number}")
        try:
            with open(os.path.join(zone, "type"), encoding="utf-8", errors="replace") as stream:
                zones.setdefault(stream.readline().strip(), []).append(zone)
        except OSError:
            continue  # a zone that goes away while it is looked at
    return zones


class ZoneSensor:
    """One input and the thermal zone that carries it."""

    def __init__(self, name: str, zone_type: str) -> None:
        self.name = name
        self.zone_type = zone_type
        self.trouble = ""
        """Why the last reading gave no value."""
        self._descriptor = -1

    def open(self, zones: dict[str, list[str]]) -> None:
        """Take the first zone of the type among ``zones``, in place of the one it had."""
        self.close()
        folders = zones.get(self.zone_type)
        if not folders:
            self.trouble = f"no thermal zone of type '{self.zone_type}'"
            return
        try:
            self._descriptor = os.open(os.path.join(folders[0], "temp"), os.O_RDONLY)
        except OSError as error:
            self.trouble = f"{error.filename}: {error.strerror}"

    def read(self) -> float | None:
        """The temperature in degC, or None where there is none now."""
        if self._descriptor < 0:
            return None
        try:
            content = os.pread(self._descriptor, _BUFFER_BYTES, 0)
        except OSError as error:
            self.trouble = error.strerror or str(error)
            return None
        value = temperature_degC(content)
        if value is None:
            self.trouble = f"it says {content!r}"
        return value

    def close(self) -> None:
        """Let the descriptor go."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class Zones:
    """The thermal zones of a model's inputs. ``note`` is told what goes and what returns, once each."""

    def __init__(self, root: str, sensors: Sequence[ZoneSensor], note: Callable[[str], None]) -> None:
        self._root = root
        self._sensors = sensors
        self._note = note
        self._notices = [Notice() for _ in sensors]
        self._lost: set[str] = set()
        self._look_at_s = 0.0
        self._wait_s = _FIRST_WAIT_S
        zones = find_zones(root)
        for sensor in sensors:
            sensor.open(zones)
            folders = zones.get(sensor.zone_type, [])
            if len(folders) > 1:
                note(f"sensor {sensor.name}: {len(folders)} zones of type '{sensor.zone_type}', taking {folders[0]}")

    def read(self, now_s: float) -> list[float | None]:
        """One temperature in degC per sensor, None where it is missing; ``now_s`` paces the search for lost zones."""
        values = [sensor.read() for sensor in self._sensors]
        if None in values and self._is_time_to_look(now_s, values):
            values = self._looked_up(values)
        for sensor, notice, value in zip(self._sensors, self._notices, values):
            if notice.changed(now_s, value is None):
                self._note(
                    f"sensor {sensor.name}: {'is back' if value is not None else f'no value ({sensor.trouble})'}"
                )
        self._lost = {sensor.name for sensor, value in zip(self._sensors, values) if value is None}
        return values

    def _is_time_to_look(self, now_s: float, values: list[float | None]) -> bool:
        lost = {sensor.name for sensor, value in zip(self._sensors, values) if value is None}
        if lost - self._lost:
            self._wait_s = _FIRST_WAIT_S
            self._look_at_s = min(self._look_at_s, now_s + _FIRST_WAIT_S)
        if now_s < self._look_at_s:
            return False
        self._look_at_s = now_s + self._wait_s
        self._wait_s = min(2 * self._wait_s, _LONGEST_WAIT_S)
        return True

    def _looked_up(self, values: list[float | None]) -> list[float | None]:
        zones = find_zones(self._root)
        for index, sensor in enumerate(self._sensors):
            if values[index] is None:
                sensor.open(zones)
                values[index] = sensor.read()
        return values

    def close(self) -> None:
        """Let all descriptors go."""
        for sensor in self._sensors:
            sensor.close()
