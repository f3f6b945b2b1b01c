"""Every documented frame: whole, byte by byte, cut anywhere, and with noise in between."""

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.instruments import agilent_34970a as agilent
from ambient_trainer.laboratory.instruments import greisinger_easybus as easybus
from ambient_trainer.laboratory.instruments import voetsch_vt4004 as voetsch
from ambient_trainer.laboratory.instruments.agilent_34970a import ErrorText, Identity, Scan
from ambient_trainer.laboratory.instruments.greisinger_easybus import Frame
from ambient_trainer.laboratory.instruments.voetsch_vt4004 import DONE, Fault, State
from ambient_trainer.laboratory.serial_line import Malformed


def frame(body: str) -> Frame:
    return Frame(1, easybus.VALUE, bytes.fromhex(body))


OUTPUTS = (False, True) * 7 + (False, False)
WARM = bytes.fromhex("FE 05 26 71 00 48 F7 80 09")
PROTOCOLS = {"chamber": voetsch, "multiplexer": agilent, "thermometer": easybus}
# by instrument and what it is, the bytes of a frame and the reply that they are
FRAMES: dict[str, tuple[bytes, Any]] = {
    "chamber, state": (
        b"0010.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r",
        State((10.0, 11.2, *(0.0, 11.2) * 4), OUTPUTS),
    ),
    "chamber, below zero": (
        b"-020.0 -018.7 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r",
        State((-20.0, -18.7, *(0.0, 11.2) * 4), OUTPUTS),
    ),
    "chamber, done": (b"0\r", DONE),
    "chamber, fault": (b"07 overtemperature\r", Fault(7, "overtemperature")),
    "chamber, no fault": (b"00\r", Fault(0, "")),
    "multiplexer, identity": (
        b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n",
        Identity("HEWLETT-PACKARD", "34970A", "0", "13-2-2"),
    ),
    "multiplexer, readings": (
        b"+2.61950000E+01,+2.62010000E+01,+2.60000000E+01\r\n",
        Scan((26.195, 26.201, 26.0), None),
    ),
    "multiplexer, with channels": (b"+2.61950000E+01,101,-3.00000000E-02,103\r\n", Scan((26.195, -0.03), (101, 103))),
    "multiplexer, open": (b"+9.90000000E+37,+2.60000000E+01,-9.90000000E+37\r\n", Scan((None, 26.0, None), None)),
    "multiplexer, undefined header": (b'-113,"Undefined header"\r\n', ErrorText(-113, "Undefined header")),
    "multiplexer, no error": (b'+0,"No error"\r\n', ErrorText(0, "No error")),
    "thermometer, 21.76": (WARM, frame("71 00 F7 80")),
    "thermometer, -0.04": (bytes.fromhex("FE 05 26 72 FF 84 00 FC 05"), frame("72 FF 00 FC")),
    "thermometer, no sensor": (bytes.fromhex("FE 0D 1E 70 F6 91 DF ED 0B"), frame("70 F6 DF ED")),
    "thermometer, number": (
        bytes.fromhex("FE C5 68 CD 40 3C 8F 08 B2"),
        Frame(1, easybus.IDENTITY, easybus.body_of_number(0x32407008)),
    ),
}
TABLE = {name: (PROTOCOLS[name.partition(",")[0]], *frame) for name, frame in FRAMES.items()}
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
@given(draw=st.data())
def test_noise_in_between_is_malformed_and_changes_nothing(protocol, data, reply, draw):
    first, second = draw.draw(NOISE[protocol]), draw.draw(NOISE[protocol])
    sent = data + first + data + second + data
    edges = [0, *sorted(draw.draw(st.lists(st.integers(0, len(sent)), max_size=8))), len(sent)]
    found, rest = [], b""
    for begin, end in itertools.pairwise(edges):
        replies, rest = protocol.decode(rest + sent[begin:end])
        found += replies
    assert [each for each in found if not isinstance(each, Malformed)] == [reply] * 3
    assert sum(isinstance(each, Malformed) for each in found) >= 2
    assert rest == b""


@pytest.mark.parametrize(
    ("protocol", "ending", "longest"), [(voetsch, b"\r", 400), (agilent, b"\n", 8192), (easybus, None, 12)]
)
@given(noise=st.binary(max_size=1000))
def test_after_any_bytes_the_next_line_is_read_and_little_is_kept(protocol, ending, longest, noise):
    _, rest = protocol.decode(noise)
    assert len(rest) <= longest
    if ending:
        _, data, reply = TABLE["chamber, state" if protocol is voetsch else "multiplexer, with channels"]
        assert protocol.decode(noise + ending + data)[0][-1] == reply


@each_frame
def test_a_part_of_a_frame_is_never_that_frame(protocol, data, reply):
    for cut in range(1, len(data)):
        assert protocol.decode(data[:cut]) == ([], data[:cut])
        assert reply not in protocol.decode(data[cut:])[0]


@pytest.mark.parametrize("data", [data for protocol, data, _ in TABLE.values() if protocol is easybus])
@given(at=st.integers(0, 8), flip=st.integers(1, 255))
def test_one_wrong_byte_leaves_no_reply_of_this_thermometer(data, at, flip):
    broken = bytearray(data)
    broken[at] ^= flip
    replies = [each for each in easybus.decode(bytes(broken))[0] if isinstance(each, Frame)]
    assert not [each for each in replies if each.address == 1 and len(each.body) == 4]
