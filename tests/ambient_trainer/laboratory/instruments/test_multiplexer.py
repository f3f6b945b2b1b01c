from __future__ import annotations

import pytest

from ambient_model.faults import Refused
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer, NotUnderstood
from ambient_trainer.laboratory.instruments.offsets import ProbeOffset
from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.simulated.multiplexer import SimulatedMultiplexer


@pytest.fixture
def simulated(clock, tmp_path):
    """Five channels at their own temperatures: 10.1 degC on 101, and so on; no errors."""
    ambients = {channel: (lambda at_s, channel=channel: channel / 10.0) for channel in (101, 102, 103, 105, 203)}
    made = SimulatedMultiplexer(
        clock, ambients, channels=list(ambients), folder=str(tmp_path), errors_K=dict.fromkeys(ambients, 0.0)
    )
    yield made
    made.close()


@pytest.fixture
def driver(simulated, clock):
    """Makes drivers of it."""
    made = []

    def make(probes, offsets=None, **options) -> Multiplexer:
        made.append(Multiplexer(simulated.port, probes, offsets, clock=clock, **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_every_probe_gets_its_own_channel_in_whatever_order_they_are_named(driver) -> None:
    probes = {"shelf": 203, "air3": 103, "air1": 101, "wall": 105}
    multiplexer = driver(probes)
    assert multiplexer.identify() == "HEWLETT-PACKARD 34970A, firmware 13-2-2"
    temps_degC = multiplexer.read().temps_degC
    assert dict(temps_degC) == {name: pytest.approx(channel / 10.0, abs=0.1) for name, channel in probes.items()}


def test_the_documented_commands_set_it_up(driver, simulated) -> None:
    said: list[bytes] = []
    hear = simulated._hear
    simulated._hear = lambda data: (said.append(data), hear(data))[1]
    driver({"a": 101, "b": 102, "c": 103}).read()
    assert b"".join(said) == (
        b"SYST:ERR?\n*IDN?\n*RST\n*CLS\nCONF:TEMP TC,K,(@101:103)\nROUT:SCAN (@101:103)\nFORM:READ:CHAN ON\n"
        b"SYST:ERR?\nREAD?\n"
    )


def test_an_open_thermocouple_is_missing_and_comes_back(driver, simulated) -> None:
    multiplexer = driver({"a": 101, "b": 102})
    simulated.open_circuit(102)
    temps_degC = multiplexer.read().temps_degC
    assert temps_degC["a"] is not None
    assert temps_degC["b"] is None
    simulated.mend(102)
    assert multiplexer.read().temps_degC["b"] == pytest.approx(10.2, abs=0.1)


def test_each_probes_offset_is_added(driver, simulated) -> None:
    simulated.open_circuit(103)
    offsets = {
        "a": ProbeOffset.constant(5.0),
        "b": ProbeOffset(((0.0, 0.0), (20.4, 20.0))),
        "c": ProbeOffset.constant(1.0),
    }
    temps_degC = driver({"a": 101, "b": 102, "c": 103, "d": 105}, offsets).read().temps_degC
    assert temps_degC["a"] == pytest.approx(15.1, abs=0.1)
    assert temps_degC["b"] == pytest.approx(10.2 + 10.0, abs=0.2)
    assert temps_degC["c"] is None
    assert temps_degC["d"] == pytest.approx(10.5, abs=0.1)


def test_switched_off_and_on_it_has_forgotten_its_scan_and_gets_it_again(driver, simulated) -> None:
    multiplexer = driver({"a": 101})
    multiplexer.read()
    simulated.restart()
    with pytest.raises(NotUnderstood) as caught:
        multiplexer.read()
    assert caught.value.expected == "1 reading, of (@101)"
    assert caught.value.got == 'nothing in 5 s, and to SYST:ERR? -221,"Settings conflict"'
    assert multiplexer.read().temps_degC["a"] == pytest.approx(10.1, abs=0.1)


def test_a_channel_that_is_not_there_is_the_instruments_own_complaint(driver) -> None:
    with pytest.raises(NotUnderstood, match='expected the scan to be set up, got error -224,"Illegal parameter value"'):
        driver({"a": 301}).configure()


def test_readings_of_other_channels_are_refused(driver, simulated) -> None:
    multiplexer = driver({"a": 101, "b": 102})
    multiplexer.read()
    simulated.twist(lambda reply: [(0.0, reply.replace(b",101,", b",103,"))])
    with pytest.raises(LineError, match=r"expected 2 readings, of \(@101:102\), got the answer to another question"):
        multiplexer.read()


def test_another_maker_is_refused(driver, simulated) -> None:
    simulated.twist(lambda reply: [(0.0, reply)])  # the marker's
    simulated.twist(lambda reply: [(0.0, b"KEITHLEY,2700,1,A1\r\n")])
    with pytest.raises(LineError, match="expected the identity of a 34970A, got that of a KEITHLEY 2700"):
        driver({"a": 101}).read()


def test_unknown_headers_are_queued_and_told_one_by_one(simulated) -> None:
    def replies(line: bytes) -> bytes:
        return b"".join(work.reply for work in simulated._hear(line))

    assert replies(b"BOGUS\nFORM:READ:COLOUR ON\n") == b""
    assert replies(b"SYST:ERR?\nSYSTem:ERRor?\nSYST:ERR?\n") == (
        b'-113,"Undefined header"\r\n-113,"Undefined header"\r\n+0,"No error"\r\n'
    )
    assert replies(b"BOGUS;" * 12 + b"\n") == b""
    told = replies(b"SYST:ERR?\n" * 12).splitlines()
    assert told[8:11] == [b'-113,"Undefined header"', b'-350,"Error queue overflow"', b'+0,"No error"']


def test_the_channels_numbers_are_switched_off_by_the_next_configuration(simulated) -> None:
    works = list(simulated._hear(b"CONF:TEMP TC,K,(@101:102)\nFORM:READ:CHAN ON\nREAD?\n"))
    assert works[-1].reply.count(b",") == 3
    works = list(simulated._hear(b"CONF:TEMP TC,K,(@101:102)\nREAD?\n"))
    assert works[-1].reply.count(b",") == 1


@pytest.mark.parametrize(
    ("probes", "offsets", "thermocouple", "fault"),
    [
        ({}, {}, "K", "probes: none; name at least one, with its channel"),
        ({"a": 100}, {}, "K", "probes.a: channel 100; a channel is its slot, 1 to 3, and two digits, as 101"),
        ({"a": 101, "b": 101}, {}, "K", "probes.b: channel 101 stands twice; give each probe a channel of its own"),
        ({"a": 101}, {"b": ProbeOffset.constant(1.0)}, "K", "offsets.b: no probe has this name; the probes are a"),
        ({"a": 101}, {}, "Q", "thermocouple: 'Q'; it is one of B, E, J, K, N, R, S, T"),
    ],
)
def test_what_cannot_be_scanned_is_refused(probes, offsets, thermocouple, fault) -> None:
    with pytest.raises(Refused) as caught:
        Multiplexer("/nowhere/port", probes, offsets, thermocouple=thermocouple)
    assert fault in str(caught.value)


def test_a_probe_follows_the_air_with_its_lag(clock, tmp_path) -> None:
    simulated = SimulatedMultiplexer(
        clock, lambda at_s: 0.0 if at_s < 1000.0 else 10.0, channels=[101], folder=str(tmp_path), errors_K={101: 0.0}
    )
    probe = simulated._probes[101]
    felt = [probe._feel(at_s) for at_s in (990.0, 1000.0, 1004.5, 1008.5, 1060.0)]
    simulated.close()
    # a lag of 4 s behind a step that is laid straight over the second before it
    assert felt == pytest.approx([0.0, 1.2, 7.1, 8.9, 10.0], abs=0.15)
