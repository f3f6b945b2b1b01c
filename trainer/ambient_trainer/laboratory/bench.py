"""What stands on the bench: a campaign's instruments, opened when first asked, and what a sample of each is.

A column's name is made here, once: the trace takes the device's, the file beside it the instruments' own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory.campaign import Ambient, Campaign, Loaded
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.device import DeviceUnderTest
from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.messages import CHAMBER, DEVICE, MULTIPLEXER, THERMOMETER, Sample, Timebase
from ambient_trainer.laboratory.shell import Way, way_to

THERMOMETER_COLUMN = "thermometer_degC"
CLOCK_OFFSET = "device_clock_offset_s"


class Bench(NamedTuple):
    """The instruments of one campaign."""

    campaign: Campaign
    chamber: Chamber
    multiplexer: Multiplexer
    thermometer: Thermometer | None
    device: DeviceUnderTest
    way: Way
    """To the device, for its actions."""

    def close(self) -> None:
        """Give everything back."""
        for each in (self.chamber, self.multiplexer, self.thermometer, self.device):
            if each is not None:
                each.close()


def bench_of(loaded: Loaded, clock: Clock, environment: Mapping[str, str] | None = None) -> Bench:
    """The instruments that a campaign names; ``environment`` is added to that of the device's shells."""
    laboratory = loaded.campaign.laboratory
    links, limits = laboratory.instruments, laboratory.safety.chamber
    chamber = Chamber(
        links.chamber.port,
        limits.low_degC,
        limits.high_degC,
        clock=clock,
        pause_s=links.chamber.pause_s,
        timeout_s=links.chamber.timeout_s,
    )
    multiplexer = Multiplexer(
        links.multiplexer.port,
        links.multiplexer.probes,
        loaded.offsets,
        thermocouple=links.multiplexer.thermocouple,
        clock=clock,
        baud=links.multiplexer.baud,
        timeout_s=links.multiplexer.timeout_s,
    )
    thermometer = None
    if link := links.thermometer:
        thermometer = Thermometer(link.port, address=link.address, clock=clock, timeout_s=link.timeout_s)
    way = way_to(laboratory.device.connect, environment)
    device = DeviceUnderTest(laboratory.device, way, clock)
    return Bench(loaded.campaign, chamber, multiplexer, thermometer, device, way)


def identities(bench: Bench) -> list[tuple[str, str]]:
    """What each instrument says that it is; raises :class:`Refused` with all that do not answer as they should."""
    found: list[tuple[str, str]] = []
    faults: list[Fault] = []
    asked: list[tuple[str, Callable[[], str]]] = [
        (CHAMBER, lambda: _without_alarm(bench)),
        (MULTIPLEXER, lambda: _scanned(bench)),
        (DEVICE, lambda: _zones(bench)),
    ]
    if bench.thermometer is not None:
        asked.append((THERMOMETER, bench.thermometer.identify))
    for source, ask in asked:
        try:
            found.append((source, ask()))
        except LineError as error:
            faults.append(Fault(f"{source} on {error.port}", f"expected {error.expected}, got {error.got}", error.mend))
    if faults:
        raise Refused("the laboratory is not ready, and nothing was moved", faults)
    return found


def _without_alarm(bench: Bench) -> str:
    text = bench.chamber.identify()
    alarm = bench.chamber.read().alarm
    if alarm is not None:
        raise InAlarm(CHAMBER, bench.chamber.port, "no alarm", alarm)
    return text


def _scanned(bench: Bench) -> str:
    text = bench.multiplexer.identify()
    temps_degC = bench.multiplexer.read().temps_degC
    silent = [name for name in bench.campaign.laboratory.ambient.probes if temps_degC[name] is None]
    if silent:
        problem = f"no reading of {', '.join(silent)}"
        raise OpenProbe(MULTIPLEXER, bench.multiplexer.port, "a reading of every probe of the ambient", problem)
    return text


def _zones(bench: Bench) -> str:
    reading = bench.device.read()
    silent = [column for column, value in reading.values.items() if value is None]
    if bench.device.missing or silent:
        missing = f"no zone {', '.join(bench.device.missing)}" if bench.device.missing else ""
        problem = "; ".join(part for part in (missing, f"nothing for {', '.join(silent)}") if part)
        raise NothingThere(DEVICE, bench.device.port, f"values for {len(reading.values)} columns", problem)
    return f"{bench.device.port}, up for {reading.clock_offset_s + 0.5 * (reading.asked_s + reading.answered_s):.0f} s"


class InAlarm(LineError):
    """The chamber has an alarm before anything began."""

    mend = "see to it, and acknowledge it at the chamber"


class OpenProbe(LineError):
    """A thermocouple is open."""

    mend = "connect it, or take it out of 'laboratory.ambient.probes'"


class NothingThere(LineError):
    """The device lacks what the campaign logs."""

    mend = "correct 'laboratory.device' after what is in /sys/class on the device"


def multiplexer_sample(bench: Bench, timebase: Timebase) -> Sample:
    """A scan of all probes."""
    reading = bench.multiplexer.read()
    values = {probe_column(name): value for name, value in reading.temps_degC.items()}
    return Sample(MULTIPLEXER, timebase.of(reading.asked_s), timebase.of(reading.answered_s), values)


def thermometer_sample(bench: Bench, timebase: Timebase) -> Sample:
    """What the reference thermometer says."""
    assert bench.thermometer is not None
    reading = bench.thermometer.read()
    asked_s, answered_s = timebase.of(reading.asked_s), timebase.of(reading.answered_s)
    return Sample(THERMOMETER, asked_s, answered_s, {THERMOMETER_COLUMN: reading.temp_degC}, reading.reason)


def device_sample(bench: Bench, timebase: Timebase) -> Sample:
    """Zones and power supply, and the device's uptime less the run's time."""
    reading = bench.device.read()
    values = {**reading.values, CLOCK_OFFSET: round(reading.clock_offset_s + timebase.zero_s, 4)}
    notes = ["was started anew"] if reading.rebooted else []
    notes += [f"has no zone {zone}" for zone in bench.device.missing]
    asked_s, answered_s = timebase.of(reading.asked_s), timebase.of(reading.answered_s)
    return Sample(DEVICE, asked_s, answered_s, values, "; ".join(notes) or None)


def probe_column(name: str) -> str:
    """The column of the probe of that name."""
    return f"probe_{name}_degC"


def ambient_degC(values: Mapping[str, float | None], ambient: Ambient) -> float | None:
    """The mean of the probes that answered; None where they are too few."""
    known = [value for name in ambient.probes if (value := values.get(probe_column(name))) is not None]
    return mean(known) if len(known) >= ambient.at_least else None


def mean(values: Iterable[float]) -> float:
    """To the digits that a probe's reading has."""
    known = list(values)
    return round(sum(known) / len(known), 4)
