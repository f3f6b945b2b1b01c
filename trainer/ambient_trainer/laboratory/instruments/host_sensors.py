"""Temperature sensors of this machine as its kernel shows them: 1-wire, iio and hwmon. A channel is a file under /sys.

They are in millidegrees (Documentation/ABI/testing/sysfs-bus-iio, Documentation/hwmon/sysfs-interface.rst); what an iio
sensor has as ``_raw`` needs the offset and the scale beside it. ``w1_slave`` has the check of the sensor's own CRC in
its first line; 85 degC is what a DS18B20 holds before its first conversion (its data sheet, table 1).
"""

import contextlib
import os
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.data.strict_yaml import wrong
from ambient_trainer.laboratory.instruments import (
    PLAUSIBLE_DEGC,
    Air,
    MultiplexerSettings,
    Name,
    Positive,
    probe_values,
)
from ambient_trainer.laboratory.messages import Clock, Disconnected, NoResponse, Reading

_POWER_ON_DEGC = 85.0
_CHANNEL_HINT = "name a file below /sys, such as bus/iio/devices/iio:device0/in_temp_input, or a 1-wire number"


def _a_file(channel: str) -> str:
    if not channel or channel.startswith("/") or ".." in channel:
        raise wrong(f"channel {channel!r}", _CHANNEL_HINT)
    return channel if "/" in channel else f"bus/w1/devices/{channel}/w1_slave"


class Settings(MultiplexerSettings):
    """The sensors: ``probes`` maps a name to a file below ``port``, in which ``*`` stands for a number that changes.

    A name without ``/``, such as 28-0316a279d1ff, is the 1-wire sensor of that number, which takes 0.8 s for a reading.
    """

    kind: Literal["host-sensors"]
    port: str = "/sys"
    period_s: Positive = 5.0
    probes: Annotated[dict[Name, Annotated[str, AfterValidator(_a_file)]], Field(min_length=1)]


class _Question(threading.Thread):
    """One file, read in a thread of its own: a bus takes its time, and some of them side by side take it once."""

    answer: tuple[float | None, str | None] = None, None

    def __init__(self, root: str, channel: str) -> None:
        super().__init__(name=channel, daemon=True)
        self._root, self._channel = Path(root), channel
        self.start()

    def run(self) -> None:
        """Read it; the answer is a temperature, or why there is none."""
        try:
            files = sorted(self._root.glob(self._channel))
            if len(files) != 1:
                raise ValueError(f"{len(files)} files where one is expected")
            value = _read(files[0])
            if not PLAUSIBLE_DEGC[0] <= value <= PLAUSIBLE_DEGC[1]:
                raise ValueError(f"{value:g} degC")
            self.answer = value, None
        except (OSError, ValueError) as error:
            self.answer = None, os.strerror(error.errno or 0) if isinstance(error, OSError) else str(error)


def _read(file: Path) -> float:
    """The temperature in a file, in degC; raises ``ValueError`` with the reason where it holds none."""
    text = file.read_text()
    if not text.endswith("\n"):
        raise ValueError("an answer that is cut")
    if file.name == "w1_slave":
        checked, _, text = text.rpartition("t=")
        if "YES" not in checked:
            raise ValueError("its check is wrong")
    value = float(text)
    if file.name.endswith("_raw"):
        offset, scale = (file.with_name(file.name.removesuffix("raw") + name) for name in ("offset", "scale"))
        value += float(offset.read_text()) if offset.exists() else 0.0
        value *= float(scale.read_text()) if scale.exists() else 1.0
    if "/w1/" in str(file) and value == 1000.0 * _POWER_ON_DEGC:
        raise ValueError("85 degC, its value before the first conversion")
    return value / 1000.0


class Driver:
    """The sensors, which are read side by side."""

    def __init__(self, settings: Settings, clock: Clock, offsets: Mapping[str, ProbeOffset] | None = None) -> None:
        self._settings, self._clock, self._offsets = settings, clock, offsets
        self._late: dict[str, _Question] = {}

    def identify(self) -> str:
        self.read()
        return f"{len(self._settings.probes)} sensors of this machine: {', '.join(self._settings.probes.values())}"

    def read(self) -> Reading:
        """One reading of each; the note has why there is none of some, the error of all."""
        asked_s = self._clock.now_s()
        end_s = time.monotonic() + self._clock.patience_s(self._settings.timeout_s)
        # what is not over yet is not asked again, and its answer is of no use any more
        late = {name: each for name, each in self._late.items() if each.is_alive()}
        port, probes = self._settings.port, self._settings.probes
        asked = {name: _Question(port, probes[name]) for name in probes if name not in late}
        for each in asked.values():
            each.join(max(end_s - time.monotonic(), 0.0))
        self._late = late | {name: each for name, each in asked.items() if each.is_alive()}
        nothing = None, "no answer in time"
        results = {name: nothing if name in self._late else asked[name].answer for name in probes}
        reasons = "; ".join(f"{name}: {reason}" for name, (_, reason) in results.items() if reason)
        if all(value is None for value, _ in results.values()):
            kind = NoResponse if "no answer" in reasons else Disconnected
            hint = f"is it connected, and its driver loaded? {_CHANNEL_HINT}"
            raise kind("multiplexer", self._settings.port, "a temperature of any of its sensors", reasons, hint)
        values = probe_values({name: value for name, (value, _) in results.items()}, self._offsets)
        return Reading(asked_s, self._clock.now_s(), values, reasons or None)

    def close(self) -> None:
        """Nothing is held."""


_UPDATE_S = 0.5
_SHORTEST_S = 0.002
_STEP_K = 0.0625  # of a DS18B20 with twelve bits
_WIDTH = 7


class Simulated:
    """The sensors in ``air``; what each reads too much is drawn, or given by ``errors_K``. ``port`` is their /sys."""

    def __init__(
        self, settings: Settings, clock: Clock, air: Air, seed: int = 0, errors_K: Mapping[str, float] | None = None
    ) -> None:
        self.errors_K = dict(errors_K or dict.fromkeys(settings.probes, 0.0))
        self._clock, self._air, self._ending = clock, air, threading.Event()
        self._folder = tempfile.TemporaryDirectory(prefix="ambient-sensors-")
        self.port = self._folder.name
        self.files = {name: Path(self.port, channel.replace("*", "0")) for name, channel in settings.probes.items()}
        for file in self.files.values():
            file.parent.mkdir(parents=True, exist_ok=True)
        self._update()
        self._thread = threading.Thread(target=self._run, name="simulated sensors", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._folder.cleanup()

    def _run(self) -> None:
        while not self._ending.wait(max(self._clock.wall_s(_UPDATE_S), _SHORTEST_S)):
            self._update()

    def _update(self) -> None:
        air_degC = self._air(self._clock.now_s())
        for name, file in self.files.items():
            number = f"{round((air_degC + self.errors_K[name]) / _STEP_K) * _STEP_K * 1000.0:{_WIDTH}.0f}"
            text = f"00 : crc=00 YES\n00 t={number}\n" if file.name == "w1_slave" else f"{number}\n"
            with contextlib.suppress(FileNotFoundError), open(file, "r+" if file.exists() else "w") as stream:
                stream.write(text)  # in its place: a reader never meets half of it
