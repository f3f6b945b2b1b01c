"""The equipment of a campaign: its instruments by their kind, and its device, opened when first asked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory.campaign import LoadedCampaign
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.device_under_test import DeviceUnderTest
from ambient_trainer.laboratory.instruments import ChamberDriver, Driver, SetPointLimits, instrument, probe_column
from ambient_trainer.laboratory.messages import CHAMBER, DEVICE, MULTIPLEXER, THERMOMETER, InstrumentError
from ambient_trainer.laboratory.shell import Connection, connection_to


class Equipment(NamedTuple):
    """The chamber, what is sampled with its period, and the connection to the device for its actions."""

    chamber: ChamberDriver
    sampled: Mapping[str, tuple[Driver, float]]
    connection: Connection

    def close(self) -> None:
        """Close every port."""
        for each in (self.chamber, *(driver for driver, _ in self.sampled.values())):
            each.close()


def equipment_of(loaded: LoadedCampaign, clock: Clock, environment: Mapping[str, str] | None = None) -> Equipment:
    """The equipment that a campaign names; ``environment`` is added to that of the device's shells."""
    laboratory = loaded.campaign.laboratory
    named, limits = laboratory.instruments, laboratory.safety.chamber
    connection = connection_to(laboratory.device.connect, environment)
    device = DeviceUnderTest(laboratory.device, connection, clock)
    multiplexer = instrument(named.multiplexer.kind).Driver(named.multiplexer, clock, loaded.offsets)
    sampled = {MULTIPLEXER: (multiplexer, named.multiplexer.period_s), DEVICE: (device, laboratory.device.period_s)}
    if named.thermometer is not None:
        thermometer = instrument(named.thermometer.kind).Driver(named.thermometer, clock)
        sampled[THERMOMETER] = (thermometer, named.thermometer.period_s)
    within = SetPointLimits(named.chamber.port, limits.low_degC, limits.high_degC)
    return Equipment(instrument(named.chamber.kind).Driver(named.chamber, clock, within), sampled, connection)


def identify(equipment: Equipment, loaded: LoadedCampaign) -> list[tuple[str, str]]:
    """Each instrument's own identification.

    Raises :class:`Refused` with each that does not answer, is in alarm, or lacks a value that the campaign needs.
    """
    laboratory = loaded.campaign.laboratory
    found: list[tuple[str, str]] = []
    faults: list[Fault] = []
    drivers = {CHAMBER: equipment.chamber, **{source: driver for source, (driver, _) in equipment.sampled.items()}}
    for source, driver in drivers.items():
        try:
            found.append((source, driver.identify()))
            if source == CHAMBER and (alarm := driver.read().note):
                hint = "see to it, and acknowledge it at the chamber"
                raise InstrumentError(source, laboratory.instruments.chamber.port, "no alarm", alarm, hint)
            if source == MULTIPLEXER:
                values = driver.read().values
                if silent := [name for name in laboratory.ambient.probes if values[probe_column(name)] is None]:
                    port, expected = laboratory.instruments.multiplexer.port, "a reading of every probe of the ambient"
                    hint = "connect it, or take it out of 'laboratory.ambient.probes'"
                    raise InstrumentError(source, port, expected, f"no reading of {', '.join(silent)}", hint)
        except InstrumentError as error:
            problem = f"expected {error.expected}, got {error.got}"
            faults.append(Fault(f"{source} on {error.port}", problem, error.hint))
    if faults:
        raise Refused("the laboratory is not ready, and nothing was moved", faults)
    return found
