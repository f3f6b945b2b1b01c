from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.protocols import agilent
from ambient_trainer.laboratory.protocols.agilent import Decoder, ErrorText, Identity, Scan
from ambient_trainer.laboratory.protocols.misread import Misread

READ = b"+2.61950000E+01,+2.62010000E+01,+2.60000000E+01\r\n"
FRAMES = {
    "identity": (b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n", Identity("HEWLETT-PACKARD", "34970A", "0", "13-2-2")),
    "readings": (READ, Scan((26.195, 26.201, 26.0), None)),
    "readings with channels": (
        b"+2.61950000E+01,101,-3.00000000E-02,103\r\n",
        Scan((26.195, -0.03), (101, 103)),
    ),
    "one reading": (b"-1.00000000E+01\r\n", Scan((-10.0,), None)),
    "open": (b"+9.90000000E+37,+2.60000000E+01,-9.90000000E+37\r\n", Scan((None, 26.0, None), None)),
    "undefined": (b'-113,"Undefined header"\r\n', ErrorText(-113, "Undefined header")),
    "no error": (b'+0,"No error"\r\n', ErrorText(0, "No error")),
}
each_frame = pytest.mark.parametrize(("frame", "reply"), FRAMES.values(), ids=FRAMES)
FOREIGN = st.binary(min_size=1, max_size=40).map(lambda data: bytes(byte | 0x80 for byte in data))


@each_frame
def test_whole(frame, reply) -> None:
    assert Decoder().feed(frame) == [reply]


@each_frame
def test_byte_by_byte(frame, reply) -> None:
    decoder = Decoder()
    assert [decoder.feed(frame[at : at + 1]) for at in range(len(frame))] == [[]] * (len(frame) - 1) + [[reply]]


@each_frame
@given(noise=FOREIGN, more=FOREIGN, cuts=st.lists(st.integers(0, 250), max_size=8))
def test_noise_in_between_is_told_and_changes_nothing(in_pieces, frame, reply, noise, more, cuts) -> None:
    found = in_pieces(Decoder(), frame + noise + frame + more + frame, cuts)
    assert [each for each in found if not isinstance(each, Misread)] == [reply] * 3
    assert len(found) == 5


@given(noise=st.binary(max_size=300))
def test_a_line_behind_any_noise_that_ended_is_read(noise) -> None:
    assert Decoder().feed(noise + b"\n" + READ)[-1] == FRAMES["readings"][1]


@given(data=st.binary(max_size=1000))
def test_no_bytes_upset_it(data) -> None:
    Decoder().feed(data)


@pytest.mark.parametrize("cut", [cut for cut in range(1, len(READ) - 2) if READ[cut - 1 : cut] != b","])
def test_a_part_of_a_reading_is_none(cut) -> None:
    assert Decoder().feed(READ[:cut]) == []
    (misread,) = Decoder().feed(READ[cut:])
    assert isinstance(misread, Misread)


def test_the_documented_commands() -> None:
    assert agilent.IDENTITY == b"*IDN?\n"
    assert agilent.RESET == b"*RST\n*CLS\n"
    assert agilent.READ == b"READ?\n"
    assert agilent.configure([101, 102, 103], "K") == b"CONF:TEMP TC,K,(@101:103)\nROUT:SCAN (@101:103)\n"


def test_channels_stand_in_the_order_in_which_they_are_scanned() -> None:
    assert agilent.channel_list([203, 101, 102, 110, 103]) == b"(@101:103,110,203)"


@pytest.mark.parametrize("name", [name for name in FRAMES if name not in ("identity", "undefined", "no error")])
def test_what_the_simulated_multiplexer_says_are_the_documented_bytes(name) -> None:
    frame, scan = FRAMES[name]
    assert agilent.scan_line(scan) == frame.replace(b"-9.90000000E+37", b"+9.90000000E+37")
