"""The device under test: zones and power supply in one round trip a sample, each in the unit that its column names.

Millidegrees, tenths, microamperes and microvolts become degC, A and V here, once. A zone is known by its type, since
their numbers change at a boot. Each sample reads the device's uptime, too: as in NTP, the clock offset is its time less
the middle of asking and answering, wrong by at most half the delay between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ambient_trainer.laboratory.campaign import Device
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.shell import Shell, Way

_LEAST_DEGC = -60.0
_MOST_DEGC = 250.0
"""Beyond them a reading is a driver's way to say that it has none, such as -274000 or -32768000."""
_LOOK_AGAIN = 30
"""Samples until zones that were not there are looked for again: after a boot, drivers come one after the other."""
_PER_UNIT = {"temp": 10.0, "current_now": 1e6, "voltage_now": 1e6}

_SAMPLE = """ambient_sample() {
read -r answer _ <ROOT/proc/uptime
for file in $ambient_files; do value=; read -r value <$file; answer="$answer|$value"; done
} 2>/dev/null"""
_LIST = """for zone in ROOT/sys/class/thermal/thermal_zone*; do
kind=; { read -r kind <$zone/type; } 2>/dev/null; answer="$answer|$zone=$kind"
done"""


class Misfit(LineError):
    """The device answers otherwise than the campaign says."""

    mend = "compare the campaign with what is in /sys/class on the device"


class DeviceReading(NamedTuple):
    """One sample of the device."""

    asked_s: float
    """When the question went out, in the clock's seconds, as ``answered_s``."""
    answered_s: float
    values: Mapping[str, float | None]
    """By the trace's column; None where the device had nothing to say."""
    clock_offset_s: float
    """The device's uptime less the time here, at the middle of the two."""
    rebooted: bool
    """Whether it was started anew since the sample before."""


class DeviceUnderTest:
    """The device of a campaign. Raises :class:`LineError`; after any, it may simply be asked again."""

    def __init__(self, device: Device, way: Way, clock: Clock) -> None:
        self.device = device
        self.port = way.label
        self.missing: tuple[str, ...] = ()
        """The zones that are not there."""
        self._shell = Shell(way, clock, device.timeout_s, _SAMPLE.replace("ROOT", device.root))
        self._opened = 0
        self._until_look = 0
        self._uptime_s = 0.0
        self._files: dict[str, str] = {}

    def read(self) -> DeviceReading:
        """One sample."""
        if not self._shell.alive:
            self._shell.close()
        self._until_look -= 1
        if self._shell.opened != self._opened or not self._shell.alive or (self.missing and self._until_look < 0):
            self._look()
        answer = self._shell.ask("ambient_sample")
        uptime, *values = answer.text.split("|")
        try:
            uptime_s = float(uptime)
        except ValueError:
            raise self._unexpected("its uptime and its zones", answer.text) from None
        if len(values) != len(self._files):
            raise self._unexpected(f"{len(self._files)} values", answer.text)
        rebooted, self._uptime_s = uptime_s < self._uptime_s, uptime_s
        found = {column: self._value(column, text) for column, text in zip(self._files, values)}
        middle_s = 0.5 * (answer.asked_s + answer.answered_s)
        every = {column: found.get(column) for column in self.device.columns}
        return DeviceReading(answer.asked_s, answer.answered_s, every, uptime_s - middle_s, rebooted)

    def close(self) -> None:
        """Let the device go."""
        self._shell.close()

    def _look(self) -> None:
        """Find the zones by their types."""
        listed = self._shell.ask(_LIST.replace("ROOT", self.device.root)).text
        places: dict[str, list[str]] = {}
        for entry in listed.split("|")[1:]:
            place, _, kind = entry.partition("=")
            places.setdefault(kind, []).append(f"{place}/temp")
        zones = self.device.zones
        for zone in zones:
            if len(places.get(zone, [])) > 1:
                raise self._unexpected(f"one zone of type {zone}", f"{len(places[zone])} of them")
        self.missing = tuple(zone for zone in zones if zone not in places)
        self._files = {column: places[zone][0] for zone, column in zones.items() if zone in places}
        if supply := self.device.power_supply:
            folder = f"{self.device.root}/sys/class/power_supply/{supply.name}"
            self._files.update({column: f"{folder}/{attribute}" for attribute, column in supply.columns.items()})
        self._shell.ask(f"ambient_files='{' '.join(self._files.values())}'")
        self._opened = self._shell.opened
        self._until_look = _LOOK_AGAIN

    def _value(self, column: str, text: str) -> float | None:
        try:
            number = int(text)
        except ValueError:
            return None
        attribute = self._files[column].rpartition("/")[2]
        supply = self.device.power_supply
        if supply is None or column not in supply.columns.values():
            return _plausible(number / 1000.0)
        value = number / _PER_UNIT[attribute]
        if attribute == "temp":
            return _plausible(value)
        return -value + 0.0 if attribute == "current_now" and supply.charging_is == "negative" else value

    def _unexpected(self, expected: str, got: str) -> Misfit:
        return Misfit("device", self.port, expected, repr(got) if len(got) <= 80 else repr(got[:77] + "..."))


def _plausible(temp_degC: float) -> float | None:
    return temp_degC if _LEAST_DEGC <= temp_degC <= _MOST_DEGC else None
