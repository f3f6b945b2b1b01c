"""The simulated laboratory of a campaign; the drivers get ports and a shell, and do not know that it is simulated.

What is simulated takes the place of what the campaign names: ports, the connection to the device, and the commands of
its actions, each of which the simulated phone knows by its name.

The phone is its files: zones, gauge and uptime as a kernel shows them, and an ``adb`` in front of a real shell. Who
takes a sample reads the uptime first: it is a pipe, behind which the files are brought up to date for the answer. What
it does is what ``phone start ACTIVITY`` in its shell last said.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.data.strict_yaml import validated
from ambient_trainer.laboratory.campaign import Campaign, LoadedCampaign, PowerSupply
from ambient_trainer.laboratory.instruments import instrument
from ambient_trainer.laboratory.messages import Clock, in_background
from ambient_trainer.simulator import Device, Zone, load_device
from ambient_trainer.simulator.live import LiveDevice
from ambient_trainer.simulator.run import stream

_READ_S = 0.0003  # the machine's seconds that a reader takes to go: one who is still there would be taken for the next
_UPTIME_S = 5000.0  # when the simulation begins; chosen

_ADB = """#!/bin/sh
# Like `adb [-s SERIAL] shell -T sh`, where there is a cable.
here=${0%/bin/adb}
[ -e "$here/cable" ] || { echo "error: no devices/emulators found" >&2; exit 1; }
echo $$ >>"$here/shells"
exec sh
"""
_PHONE = """#!/bin/sh
# phone start|stop ACTIVITY: what the simulated phone does. Its own folder is this one's parent.
activity=${0%/bin/phone}/activity
read -r now <"$activity"
case $1 in
start) next=$2 ;;
stop) [ "$now" = "$2" ] || exit 0; next=IDLE ;;
*) exit 2 ;;
esac
echo "$next" >"$activity.$$" && mv "$activity.$$" "$activity"
"""


class SimulatedPhone:
    """The files under ``root`` of a phone whose zones have ``types``; with its ``environment``, ``adb`` is its own."""

    def __init__(
        self, clock: Clock, live: LiveDevice, types: Sequence[str], supply: PowerSupply | None, activity: str
    ) -> None:
        self._clock, self._live, self._types, self._supply = clock, live, types, supply
        self._booted_s = clock.now_s() - _UPTIME_S
        self._folder = tempfile.TemporaryDirectory(prefix="simulated-phone-")
        self.root, self._here = self._folder.name, Path(self._folder.name)
        self.environment = {"PATH": f"{self._here / 'bin'}:{os.environ.get('PATH', os.defpath)}"}
        self._ending, self._lock = threading.Event(), threading.Lock()
        self._files = self._made_files(activity)
        self._show()
        self._threads = [in_background(self._pass), in_background(self._serve)]

    def close(self) -> None:
        """End it, and whatever still runs on it."""
        self._ending.set()
        asking = os.open(self._here / "proc/uptime", os.O_RDONLY | os.O_NONBLOCK)  # nobody waits for a reader now
        for thread in self._threads:
            thread.result()
        os.close(asking)
        self._end_shells()
        for file in self._files:
            os.close(file)
        self._folder.cleanup()

    def _made_files(self, activity: str) -> dict[int, Callable[[], float]]:
        """The files that are held, and what stands in each."""
        live, places = self._live, dict[Path, Callable[[], float]]()
        for index, kind in enumerate(self._types):
            folder = self._here / f"sys/class/thermal/thermal_zone{index}"
            folder.mkdir(parents=True)
            (folder / "type").write_text(f"{kind}\n")
            places[folder / "temp"] = lambda index=index: 1000.0 * live.zones_degC[index]  # type: ignore[misc]
        (self._here / "proc").mkdir()
        os.mkfifo(self._here / "proc/uptime")
        if self._supply is not None:
            sign = 1.0 if self._supply.charging_is == "positive" else -1.0
            gauge: dict[str, Callable[[], float]] = {
                "temp": lambda: 10.0 * live.battery_degC,
                "voltage_now": lambda: 1e6 * live.battery_V,
                "current_now": lambda: 1e6 * sign * live.current_A,
            }
            folder = self._here / "sys/class/power_supply" / self._supply.name
            folder.mkdir(parents=True)
            places |= {folder / attribute: gauge[attribute] for attribute in self._supply.columns}
        programs = self._here / "bin"
        programs.mkdir()
        for name, text in (("adb", _ADB), ("phone", _PHONE.replace("IDLE", live.device.idle))):
            (programs / name).write_text(text)
            (programs / name).chmod(0o755)
        (self._here / "activity").write_text(f"{activity}\n")
        (self._here / "cable").touch()
        return {os.open(place, os.O_WRONLY | os.O_CREAT, 0o644): value for place, value in places.items()}

    def _pass(self) -> None:
        while not self._ending.is_set():
            with self._lock:
                self._advance()
            self._clock.wait(self._ending, self._live.next_s - self._clock.now_s())

    def _serve(self) -> None:
        while not self._ending.is_set():
            # waits for a reader; one that has gone in between wants no answer
            with contextlib.suppress(BrokenPipeError), open(self._here / "proc/uptime", "w") as asked, self._lock:
                self._advance()
                self._show()
                up_s = max(self._clock.now_s() - self._booted_s, 0.0)
                asked.write(f"{up_s:.2f} {up_s:.2f}\n")
            self._ending.wait(_READ_S)

    def _advance(self) -> None:
        self._live.advance(self._clock.now_s(), (self._here / "activity").read_text().strip())

    def _show(self) -> None:
        """Bring what is so now into the files, in their place: who could read meanwhile waits at the pipe."""
        for file, value in self._files.items():
            os.pwrite(file, f"{round(value()):<12}\n".encode(), 0)

    def _end_shells(self) -> None:
        shells = self._here / "shells"
        pids = shells.read_text().split() if shells.exists() else []
        shells.unlink(missing_ok=True)
        for pid in pids:
            # a number may be another program's by now
            with contextlib.suppress(OSError):
                if self.root.encode() in Path(f"/proc/{pid}/environ").read_bytes():
                    os.kill(int(pid), signal.SIGKILL)


_SWITCH_S = 2e-4
_ROOM_DEGC = 22.0
_ROOM_SWINGS = {86400.0: 1.5, 9000.0: 0.8, 1500.0: 0.3}  # period in s, and size in K; chosen


class SimulatedLaboratory(NamedTuple):
    """The campaign with the simulated instruments' ports in it, the device's environment, and what is simulated."""

    loaded: LoadedCampaign
    environment: Mapping[str, str]
    phone: SimulatedPhone
    chamber: Any = None
    multiplexer: Any = None
    thermometer: Any = None


@contextlib.contextmanager
def simulated_laboratory(loaded: LoadedCampaign, clock: Clock, seed: int = 0) -> Iterator[SimulatedLaboratory]:
    """The simulated laboratory for a campaign, for the time of a ``with`` block.

    It begins with the chamber at the program's first set point, or without one with a room's air, and the phone in
    equilibrium with it. With the same ``seed``, chamber, probes and phone have the swing, errors and noise of
    :func:`ambient_trainer.simulator.simulate`. Raises :class:`Refused` for what the simulated phone has not.
    """
    campaign, device = loaded.campaign, load_device()
    zones = _zones(loaded, device)
    named, first = campaign.laboratory.instruments, campaign.program[0]
    with contextlib.ExitStack() as stack:
        # many threads that each do little: with the usual 5 ms, an answer costs a second of a fast clock
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_S)

        def simulated(settings: Any, *arguments: object) -> Any:
            made = instrument(settings.kind).Simulated(settings, clock, *arguments)
            stack.callback(made.close)
            return made

        made: dict[str, Any] = {}
        air_degC = room_air(seed)
        if named.chamber is not None:
            made["chamber"] = simulated(named.chamber, stream(seed, "wobble"), first.chamber_degC)
            air_degC = made["chamber"].air_degC
        if named.multiplexer is not None:
            channels = named.multiplexer.probes
            probes = sorted(channels, key=lambda name: str(channels[name]))
            errors_K = device.chamber.probes.calibration_degC * stream(seed, "probes").standard_normal(len(probes))
            made["multiplexer"] = simulated(named.multiplexer, air_degC, seed, dict(zip(probes, errors_K.tolist())))
        if named.thermometer is not None:
            made["thermometer"] = simulated(named.thermometer, air_degC)
        supply, activity = campaign.laboratory.device.power_supply, first.load[0] if first.load else device.idle
        seen = tuple(zones.values())
        live = LiveDevice(device, seen, air_degC, clock.now_s(), activity, seed, campaign.before_s)
        phone = SimulatedPhone(clock, live, tuple(zones), supply, activity)
        stack.callback(phone.close)
        ports = {role: each.port for role, each in made.items()}
        there = loaded._replace(campaign=_with_simulated(campaign, ports, phone.root))
        yield SimulatedLaboratory(there, phone.environment, phone, **made)


def room_air(seed: int) -> Callable[[float], float]:
    """A room's air in degC over time: the day's swing, the heating's, and a window now and then."""
    phases = stream(seed, "room").uniform(0.0, 2.0 * math.pi, len(_ROOM_SWINGS))
    swings = [(each_s, size_K, phase) for (each_s, size_K), phase in zip(_ROOM_SWINGS.items(), phases.tolist())]
    return lambda at_s: (
        _ROOM_DEGC + sum(size_K * math.sin(math.tau * at_s / each_s + phase) for each_s, size_K, phase in swings)
    )


def _with_simulated(campaign: Campaign, ports: Mapping[str, str], root: str) -> Campaign:
    data = campaign.model_dump()
    laboratory = data["laboratory"]
    laboratory["device"].update(connect="adb", root=root, setup="")
    for role, port in ports.items():
        laboratory["instruments"][role]["port"] = port
    for name, action in laboratory["actions"].items():
        action.update(start=f"phone start {name}", stop=f"phone stop {name}")
    return validated(type(campaign), data, "the simulated laboratory")


def _zones(loaded: LoadedCampaign, device: Device) -> dict[str, Zone]:
    """By the type that the campaign reads, the simulated zone that its column names; raises :class:`Refused`."""
    known = {f"{zone.name}_degC": zone for zone in device.zones}
    campaign, does = loaded.campaign, [name for name in device.activities if name != device.idle]
    faults = [
        Fault(f"laboratory.device.zones.{kind}", f"the simulated phone has no {column}", f"it has {', '.join(known)}")
        for kind, column in campaign.laboratory.device.zones.items()
        if column not in known
    ]
    for part, steps in (("before", campaign.before), ("steps", campaign.steps)):
        for index, step in enumerate(steps):
            if len(step.load) > 1 or any(name not in does for name in step.load):
                problem = f"the simulated phone cannot do {' and '.join(step.load)}"
                hint = f"it does one at a time of {', '.join(does)}"
                faults.append(Fault(f"{part}[{index}].load", problem, hint))
    if faults:
        raise Refused(loaded.path, faults)
    return {kind: known[column] for kind, column in campaign.laboratory.device.zones.items()}
