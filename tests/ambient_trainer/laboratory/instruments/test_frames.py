"""Every documented frame: whole, byte by byte, cut anywhere, and with noise in between."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.protocols import agilent, easybus, voetsch
from ambient_trainer.laboratory.protocols.agilent import ErrorText, Identity, Scan
from ambient_trainer.laboratory.protocols.easybus import Frame, Value
from ambient_trainer.laboratory.protocols.misread import Misread
from ambient_trainer.laboratory.protocols.voetsch import Done, FaultText, State


def bits(text: str) -> tuple[bool, ...]:
    return tuple(character == "1" for character in text)


def frame(body: str) -> Frame:
    return Frame(1, easybus.VALUE, bytes.fromhex(body))


OUTPUTS = bits("0101010101010100")
TABLE: dict[str, tuple[Any, bytes, Any]] = {
    "chamber, state": (
        voetsch,
        b"0010.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r",
        State((10.0, 0.0, 0.0, 0.0, 0.0), (11.2,) * 5, OUTPUTS),
    ),
    "chamber, below zero": (
        voetsch,
        b"-020.0 -018.7 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r",
        State((-20.0, 0.0, 0.0, 0.0, 0.0), (-18.7, 11.2, 11.2, 11.2, 11.2), OUTPUTS),
    ),
    "chamber, done": (voetsch, b"0\r", Done()),
    "chamber, fault": (voetsch, b"07 overtemperature\r", FaultText(7, "overtemperature")),
    "chamber, no fault": (voetsch, b"00\r", FaultText(0, "")),
    "multiplexer, identity": (
        agilent,
        b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n",
        Identity("HEWLETT-PACKARD", "34970A", "0", "13-2-2"),
    ),
    "multiplexer, readings": (
        agilent,
        b"+2.61950000E+01,+2.62010000E+01,+2.60000000E+01\r\n",
        Scan((26.195, 26.201, 26.0), None),
    ),
    "multiplexer, with channels": (
        agilent,
        b"+2.61950000E+01,101,-3.00000000E-02,103\r\n",
        Scan((26.195, -0.03), (101, 103)),
    ),
    "multiplexer, open": (
        agilent,
        b"+9.90000000E+37,+2.60000000E+01,-9.90000000E+37\r\n",
        Scan((None, 26.0, None), None),
    ),
    "multiplexer, undefined header": (agilent, b'-113,"Undefined header"\r\n', ErrorText(-113, "Undefined header")),
    "multiplexer, no error": (agilent, b'+0,"No error"\r\n', ErrorText(0, "No error")),
    "thermometer, 21.76": (easybus, bytes.fromhex("FE 05 26 71 00 48 F7 80 09"), frame("71 00 F7 80")),
    "thermometer, -0.04": (easybus, bytes.fromhex("FE 05 26 72 FF 84 00 FC 05"), frame("72 FF 00 FC")),
    "thermometer, no sensor": (easybus, bytes.fromhex("FE 0D 1E 70 F6 91 DF ED 0B"), frame("70 F6 DF ED")),
}
VALUES = {"71 00 F7 80": Value(21.76, None), "72 FF 00 FC": Value(-0.04, None), "70 F6 DF ED": Value(None, "no sensor")}
each_frame = pytest.mark.parametrize(("protocol", "data", "reply"), TABLE.values(), ids=TABLE)


def starts_no_frame(noise: bytes) -> bool:
    """Whether no three bytes of ``noise``, or of it and what follows, are a group of the thermometer's."""
    groups = [(noise + b"\xfe\x05")[at : at + 3] for at in range(len(noise))]
    return all(easybus.check(group[0], group[1]) != group[2] for group in groups)


# what no reply of a text protocol has in it; for the other one, what is no group of its own by chance
NOISE = {
    voetsch: st.binary(min_size=1, max_size=40).map(lambda data: bytes(byte | 0x80 for byte in data)),
    easybus: st.binary(min_size=1, max_size=40).filter(starts_no_frame),
}
NOISE[agilent] = NOISE[voetsch]


@each_frame
def test_whole(protocol, data, reply) -> None:
    assert protocol.Decoder().feed(data) == [reply]


@each_frame
def test_byte_by_byte(protocol, data, reply) -> None:
    decoder = protocol.Decoder()
    assert [decoder.feed(data[at : at + 1]) for at in range(len(data))] == [[]] * (len(data) - 1) + [[reply]]


@each_frame
@given(draw=st.data())
def test_noise_in_between_is_told_and_changes_nothing(protocol, data, reply, draw) -> None:
    first, second = draw.draw(NOISE[protocol]), draw.draw(NOISE[protocol])
    sent = data + first + data + second + data
    cuts = draw.draw(st.lists(st.integers(0, len(sent)), max_size=8))
    decoder = protocol.Decoder()
    edges = [0, *sorted(cuts), len(sent)]
    found = [each for begin, end in itertools.pairwise(edges) for each in decoder.feed(sent[begin:end])]
    assert [each for each in found if not isinstance(each, Misread)] == [reply] * 3
    assert sum(isinstance(each, Misread) for each in found) >= 2
    assert decoder.rest() == b""


@pytest.mark.parametrize(("body", "value"), VALUES.items())
def test_what_the_thermometers_bytes_mean(body, value) -> None:
    assert easybus.value_of(bytes.fromhex(body)) == value


@each_frame
def test_what_the_simulated_instruments_say_are_the_documented_bytes(protocol, data, reply) -> None:
    encoders = {
        State: voetsch.state_line,
        Done: lambda reply: voetsch.DONE_LINE,
        FaultText: voetsch.fault_line,
        Scan: agilent.scan_line,
        ErrorText: lambda reply: f"{reply}\r\n".encode(),
        Identity: lambda reply: ",".join(reply).encode() + b"\r\n",
        Frame: lambda reply: easybus.reply(1, 0, reply.body, faulty=easybus.value_of(reply.body).value is None),
    }
    assert encoders[type(reply)](reply) == data.replace(b"-9.90000000E+37", b"+9.90000000E+37")
