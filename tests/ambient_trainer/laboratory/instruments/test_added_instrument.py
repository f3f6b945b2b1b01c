"""An instrument is one file: a meter in a temporary folder is driven, checked and simulated like those that ship."""

import numpy as np
import pytest

from ambient_trainer.data.plugins import plugin_names
from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory import instruments
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import laboratory_path
from refusals import refused

METER = '''
"""A meter that answers T? by a number of kelvin."""

from typing import Literal

from ambient_trainer.laboratory.instruments import THERMOMETER_COLUMN, ThermometerSettings
from ambient_trainer.laboratory.pseudo_terminal import Response, SimulatedInstrument
from ambient_trainer.laboratory.messages import Reading
from ambient_trainer.laboratory.serial_line import Query, SerialDriver, SerialLine, text_replies

decode = text_replies(b"\\n", b"\\r", 80, lambda line: line)
READ = Query(b"T?\\n", "a temperature", lambda reply: reply.startswith("T "))
WHO = Query(b"WHO?\\n", "a name", lambda reply: reply.startswith("KELVIN"))


class Settings(ThermometerSettings):
    kind: Literal["kelvin-meter"]
    baud: int = 9600


class Driver(SerialDriver):
    def __init__(self, settings, clock):
        self.line = SerialLine("thermometer", settings, clock, decode, WHO, settings.baud)

    def identify(self):
        return self.line.query(WHO).reply

    def read(self):
        asked_s, answered_s, reply = self.line.query(READ)
        return Reading(asked_s, answered_s, {THERMOMETER_COLUMN: round(float(reply[2:]) - 273.15, 2)})


class Simulated(SimulatedInstrument):
    def __init__(self, settings, clock, air):
        self._air = air
        super().__init__("thermometer", clock, settings.baud)

    def _respond(self, data):
        for line in data.split(b"\\n")[:-1]:
            reply = f"T {self._air(self._clock.now_s()) + 273.15:.2f}" if line == b"T?" else "KELVIN 1"
            yield Response(0.01, f"{reply}\\r\\n".encode())
'''


@pytest.fixture
def meter(plugged):
    plugged(instruments, "kelvin_meter", METER)


def test_one_file_adds_an_instrument(meter, night):
    link = {"kind": "kelvin-meter", "port": "/dev/ttyUSB9", "period_s": 2, "baud": 19200}
    lab = night([{"duration_min": 4, "chamber_degC": 22}], {"instruments.thermometer": link}, speed=100.0)
    assert lab.loaded.campaign.laboratory.instruments.thermometer.baud == 19200
    lab.run()
    assert lab.outcome.finished
    assert lab.trace.notes["thermometer"] == "KELVIN 1"
    reading = load_trace(laboratory_path(lab.output)).column("thermometer_degC")
    assert np.isfinite(reading).sum() > 20
    assert np.nanmean(reading) == pytest.approx(np.nanmean(lab.trace.reference), abs=1.0)


def test_its_settings_are_checked_and_it_is_known_by_its_file_only(campaign_file, meter):
    link = {"kind": "kelvin-meter", "port": "/dev/ttyUSB9", "address": 5}
    (fault,) = refused(load_campaign, campaign_file(changes={"instruments.thermometer": link}), ports=False).faults
    assert fault.place == "laboratory.instruments.thermometer.address"
    plugin_names.cache_clear()
    instruments.__path__.pop()
    (fault,) = refused(load_campaign, campaign_file(changes={"instruments.thermometer": link}), ports=False).faults
    assert fault.place == "laboratory.instruments.thermometer.kind"
    assert "greisinger-easybus" in str(fault)
