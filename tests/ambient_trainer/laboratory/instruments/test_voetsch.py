from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.protocols import voetsch
from ambient_trainer.laboratory.protocols.voetsch import Decoder, State


def bits(text: str) -> tuple[bool, ...]:
    return tuple(character == "1" for character in text)


READ = b"0010.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r"
STATE = State((10.0, 0.0, 0.0, 0.0, 0.0), (11.2,) * 5, bits("0101010101010100"))


@given(noise=st.binary(max_size=300))
def test_a_state_behind_any_noise_is_that_state_or_none(noise) -> None:
    states = [each for each in Decoder().feed(noise + READ) if isinstance(each, State)]
    assert states in ([], [STATE])


@given(noise=st.binary(max_size=300))
def test_a_line_behind_any_noise_that_ended_is_read(noise) -> None:
    assert Decoder().feed(noise + b"\r" + READ)[-1] == STATE


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
