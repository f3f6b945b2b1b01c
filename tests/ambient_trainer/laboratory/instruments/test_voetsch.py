from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.protocols import voetsch
from ambient_trainer.laboratory.protocols.misread import Misread
from ambient_trainer.laboratory.protocols.voetsch import Decoder, Done, FaultText, State


def bits(text: str) -> tuple[bool, ...]:
    return tuple(character == "1" for character in text)


READ = b"0010.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r"
COLD = b"-020.0 -018.7 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101000000000000\r"
FRAMES = {
    "state": (READ, State((10.0, 0.0, 0.0, 0.0, 0.0), (11.2,) * 5, bits("0101010101010100"))),
    "below zero": (
        COLD,
        State((-20.0, 0.0, 0.0, 0.0, 0.0), (-18.7, 11.2, 11.2, 11.2, 11.2), bits("0101000000000000")),
    ),
    "done": (b"0\r", Done()),
    "fault": (b"07 overtemperature\r", FaultText(7, "overtemperature")),
    "no fault": (b"00\r", FaultText(0, "")),
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
def test_a_state_behind_any_noise_is_that_state_or_none(noise) -> None:
    states = [each for each in Decoder().feed(noise + READ) if isinstance(each, State)]
    assert states in ([], [FRAMES["state"][1]])


@given(noise=st.binary(max_size=300))
def test_a_line_behind_any_noise_that_ended_is_read(noise) -> None:
    assert Decoder().feed(noise + b"\r" + READ)[-1] == FRAMES["state"][1]


@given(data=st.binary(max_size=1000))
def test_no_bytes_upset_it_and_little_of_them_is_kept(data) -> None:
    decoder = Decoder()
    decoder.feed(data)
    assert len(decoder.rest()) <= 200


@pytest.mark.parametrize("cut", range(1, len(READ) - 1))
def test_a_part_of_a_state_is_none(cut) -> None:
    assert Decoder().feed(READ[:cut]) == []
    (other,) = Decoder().feed(READ[cut:])
    assert not isinstance(other, State)


def test_an_empty_line_says_that_the_command_was_malformed() -> None:
    (misread,) = Decoder().feed(b"\r")
    assert misread.got == "an empty line, as after a malformed command"


def test_the_documented_commands() -> None:
    assert voetsch.STATE == b"$00I\r"
    assert voetsch.FAULT == b"$00F\r"
    assert voetsch.ACKNOWLEDGE == b"$00Q\r"
    assert (
        voetsch.set_values((10.0, 0.0, 0.0, 0.0, 0.0), bits("0101010100000100"))
        == b"$00E 0010.0 0000.0 0000.0 0000.0 0000.0 0101010100000100\r"
    )
    assert voetsch.set_values((-7.5, 0, 0, 0, 0), bits("01" * 8)).startswith(b"$00E -007.5 ")
    assert voetsch.set_gradients(2.0, 1.5) == b"$00U 0002.0 0001.5 0000.0 0000.0\r"


@each_frame
def test_what_the_simulated_chamber_says_are_the_documented_bytes(frame, reply) -> None:
    encode = {State: voetsch.state_line, FaultText: voetsch.fault_line, Done: lambda reply: voetsch.DONE_LINE}
    assert encode[type(reply)](reply) == frame
