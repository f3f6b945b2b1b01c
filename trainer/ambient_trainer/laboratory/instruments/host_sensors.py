"""Temperature sensors of this machine as its kernel shows them: 1-wire, iio and hwmon. A channel is a file under /sys.

They are in millidegrees (Documentation/ABI/testing/sysfs-bus-iio, Documentation/hwmon/sysfs-interface.rst); what an iio
sensor has as ``_raw`` needs the offset and the scale beside it. ``w1_slave`` has the check of the sensor's own CRC in
its first line; 85 degC is what a DS18B20 holds before its first conversion (its data sheet, table 1).
"""

import contextlib
import os
import tempfile
import threading
from collections.abc import Mapping
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PositiveFloat

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.data.strict_yaml import wrong
from ambient_trainer.laboratory.instruments import Air, MultiplexerSettings, Name, plausible, probe_values
from ambient_trainer.laboratory.messages import Clock, Disconnected, NoResponse, Reading, in_background

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
    period_s: PositiveFloat = 5.0
    probes: Annotated[dict[Name, Annotated[str, AfterValidator(_a_file)]], Field(min_length=1)]


def _temperature_degC(root: str, channel: str) -> float:
    """What a sensor reads; raises ``OSError``, or ``ValueError`` with the reason why that is no temperature."""
    files = sorted(Path(root).glob(channel))
    if len(files) != 1:
        raise ValueError(f"{len(files)} files where one is expected")
    file, text = files[0], files[0].read_text()
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
    if "/w1/" in str(file) and value == 85000.0:
        raise ValueError("85 degC, its value before the first conversion")
    if not plausible(value / 1000.0):
        raise ValueError(f"{value / 1000.0:g} degC")
    return value / 1000.0


class Driver:
    """The sensors, which are read side by side."""

    def __init__(self, settings: Settings, clock: Clock, offsets: Mapping[str, ProbeOffset] | None = None) -> None:
        self._settings, self._clock, self._offsets = settings, clock, offsets
        self._late: dict[str, Future[float]] = {}

    def identify(self) -> str:
        self.read()
        return f"{len(self._settings.probes)} sensors of this machine: {', '.join(self._settings.probes.values())}"

    def read(self) -> Reading:
        """One reading of each; the note has why there is none of some, the error of all."""
        asked_s, port, probes = self._clock.now_s(), self._settings.port, self._settings.probes
        # what is not over yet is not asked again, and its answer is of no use any more
        late = {name: each for name, each in self._late.items() if not each.done()}
        # side by side: a bus takes its time, and some of them take it once
        asked = {name: in_background(_temperature_degC, port, probes[name]) for name in probes if name not in late}
        over, _ = wait(asked.values(), self._clock.patience_s(self._settings.timeout_s))
        self._late = late | {name: each for name, each in asked.items() if each not in over}
        known: dict[str, float | None] = dict.fromkeys(probes)
        reasons = []
        for name in probes:
            if name in self._late:
                reasons.append(f"{name}: no answer in time")
            elif (error := asked[name].exception()) is None:
                known[name] = asked[name].result()
            else:
                reason = os.strerror(error.errno or 0) if isinstance(error, OSError) else error
                reasons.append(f"{name}: {reason}")
        if len(reasons) == len(probes):
            kind = NoResponse if self._late else Disconnected
            hint = f"is it connected, and its driver loaded? {_CHANNEL_HINT}"
            expected = "a temperature of any of its sensors"
            raise kind("multiplexer", port, expected, "; ".join(reasons), hint)
        return Reading(asked_s, self._clock.now_s(), probe_values(known, self._offsets), "; ".join(reasons) or None)

    def close(self) -> None:
        """Nothing is held."""


_UPDATE_S, _SHORTEST_S = 0.5, 0.002
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
        self._thread = in_background(self._run)

    def close(self) -> None:
        self._ending.set()
        self._thread.result()
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
