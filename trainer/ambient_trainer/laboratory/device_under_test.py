"""The device under test: zones and power supply in one round trip a sample.

A zone is known by its type, since their numbers change at a boot. Each sample reads the device's uptime, too: as in
NTP, the clock offset is its time less the middle of asking and answering, wrong by at most half the delay between them.
Millidegrees, tenths, microamperes and microvolts of a kernel become degC, A and V here, once.
"""

import math

from ambient_trainer.laboratory.campaign import DeviceConfig
from ambient_trainer.laboratory.instruments import plausible
from ambient_trainer.laboratory.messages import CLOCK_OFFSET, DEVICE, Clock, InstrumentError, Reading
from ambient_trainer.laboratory.shell import Connection, Shell

_PER_DEGC, _PER_UNIT = 1000.0, {"temp": 10.0, "current_now": 1e6, "voltage_now": 1e6}


def value_in(text: str, per_unit: float, temperature: bool) -> float | None:
    """What a kernel's file holds, in degC, A or V; None for no value, or no plausible one of a ``temperature``."""
    try:
        value = int(text) / per_unit + 0.0  # no -0.0
    except ValueError:
        return None
    return value if not temperature or plausible(value) else None


_SAMPLES_UNTIL_SEARCH = 31.0
"""Until zones that were not there are searched again: after a boot, drivers come one after the other."""
_MISMATCH = "compare the campaign with what is in /sys/class on the device"
_SAMPLE = """ambient_sample() {
read -r answer _ <ROOT/proc/uptime || read -r answer _ <ROOT/proc/uptime
for file in $ambient_files; do value=; read -r value <$file; answer="$answer|$value"; done
} 2>/dev/null"""
_LIST = """for zone in ROOT/sys/class/thermal/thermal_zone*; do
kind=; { read -r kind <$zone/type; } 2>/dev/null; answer="$answer|$zone=$kind"
done"""


class DeviceUnderTest:
    """The device of a campaign. Raises :class:`InstrumentError`; after any, it may simply be asked again."""

    def __init__(self, device: DeviceConfig, connection: Connection, clock: Clock) -> None:
        self.device, self.connection, self.port = device, connection, connection.label
        self.missing: tuple[str, ...] = ()
        """The zones that are not there."""
        self._shell = Shell(connection, clock, device.timeout_s, _SAMPLE.replace("ROOT", device.root))
        self._until_search = self._uptime_s = 0.0
        self._columns: dict[str, tuple[str, float, bool]] = {}
        """By column the file, how many of its units are one of the column's, and whether it is a temperature."""

    def identify(self) -> str:
        """How it is reached, and how long it is up; raises where it lacks what the campaign logs."""
        silent = [column for column, value in self.read().values.items() if value is None]
        problems = [f"no zone {', '.join(self.missing)}"] * bool(self.missing)
        if problems := problems + [f"nothing for {', '.join(silent)}"] * bool(silent):
            hint = "correct 'laboratory.device' after what is in /sys/class on the device"
            expected = f"values for {len(self.device.columns)} columns"
            raise InstrumentError(DEVICE, self.port, expected, "; ".join(problems), hint)
        return f"{self.port}, up for {self._uptime_s:.0f} s"

    def read(self) -> Reading:
        """One sample, with the device's clock offset; None where the device has no value."""
        if not self._shell.alive:
            self._shell.close()
            self._until_search = 0.0
        if self._until_search <= 0.0:
            self._search_zones()
        self._until_search -= 1.0
        answer = self._shell.run("ambient_sample")
        uptime, *texts = answer.text.split("|")
        try:
            uptime_s = float(uptime)
        except ValueError:
            uptime_s = math.nan
        if math.isnan(uptime_s) or len(texts) != len(self._columns):
            raise self._unexpected(f"its uptime and {len(self._columns)} values", answer.text)
        rebooted, self._uptime_s = uptime_s < self._uptime_s, uptime_s
        values: dict[str, float | None] = dict.fromkeys(self.device.columns)
        for (column, (_, per_unit, temperature)), text in zip(self._columns.items(), texts):
            values[column] = value_in(text, per_unit, temperature)
        values[CLOCK_OFFSET] = uptime_s - 0.5 * (answer.asked_s + answer.answered_s)
        notes = ["was started anew"] * rebooted + [f"has no zone {zone}" for zone in self.missing]
        return Reading(answer.asked_s, answer.answered_s, values, "; ".join(notes) or None)

    def close(self) -> None:
        """Close the shell."""
        self._shell.close()

    def _search_zones(self) -> None:
        """Find the zones by their types."""
        device = self.device
        files: dict[str, list[str]] = {}
        for entry in self._shell.run(_LIST.replace("ROOT", device.root)).text.split("|")[1:]:
            folder, _, kind = entry.partition("=")
            files.setdefault(kind, []).append(f"{folder}/temp")
        for zone in device.zones:
            if len(files.get(zone, [])) > 1:
                raise self._unexpected(f"one zone of type {zone}", f"{len(files[zone])} of them")
        self.missing = tuple(zone for zone in device.zones if zone not in files)
        found = {column: files[zone][0] for zone, column in device.zones.items() if zone in files}
        self._columns = {column: (file, _PER_DEGC, True) for column, file in found.items()}
        if supply := device.power_supply:
            folder = f"{device.root}/sys/class/power_supply/{supply.name}"
            for attribute, column in supply.columns.items():
                sign = -1.0 if attribute == "current_now" and supply.charging_is == "negative" else 1.0
                self._columns[column] = (f"{folder}/{attribute}", sign * _PER_UNIT[attribute], attribute == "temp")
        self._shell.run(f"ambient_files='{' '.join(file for file, *_ in self._columns.values())}'")
        self._until_search = _SAMPLES_UNTIL_SEARCH if self.missing else math.inf

    def _unexpected(self, expected: str, got: str) -> InstrumentError:
        shown = repr(got) if len(got) <= 80 else repr(got[:77] + "...")
        return InstrumentError(DEVICE, self.port, expected, shown, _MISMATCH)
