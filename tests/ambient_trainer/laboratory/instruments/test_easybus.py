from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.protocols import easybus
from ambient_trainer.laboratory.protocols.easybus import Decoder, Frame, Value
from ambient_trainer.laboratory.protocols.misread import Misread

WARM = bytes.fromhex("FE 05 26 71 00 48 F7 80 09")
FRAMES = (WARM, bytes.fromhex("FE 05 26 72 FF 84 00 FC 05"), bytes.fromhex("FE 0D 1E 70 F6 91 DF ED 0B"))


@pytest.mark.parametrize("frame", FRAMES)
@given(at=st.integers(0, 8), flip=st.integers(1, 255))
def test_one_wrong_byte_leaves_no_reply_of_this_thermometer(frame, at, flip) -> None:
    broken = bytearray(frame)
    broken[at] ^= flip
    replies = [each for each in Decoder().feed(bytes(broken)) if isinstance(each, Frame)]
    assert not [each for each in replies if each.address == 1 and len(each.body) == 4]


@pytest.mark.parametrize("cut", range(1, 9))
def test_a_part_of_a_frame_is_none_and_the_next_one_is_read_or_told_to_be_odd(cut) -> None:
    frame = WARM
    decoder = Decoder()
    assert decoder.feed(frame[:cut]) == []
    assert decoder.rest() == frame[:cut]
    found = decoder.feed(frame)
    values = [easybus.value_of(each.body) for each in found if isinstance(each, Frame)]
    assert values == [Value(21.76, None)] or cut % 3 == 0  # there the frame's head may be a value's groups
    assert len(values) < len(found)


@given(data=st.binary(max_size=200))
def test_no_bytes_upset_it_and_little_of_them_is_kept(data) -> None:
    decoder = Decoder()
    decoder.feed(data)
    assert len(decoder.rest()) < 12


def test_the_documented_check_and_requests() -> None:
    for frame in FRAMES:
        assert [easybus.check(*frame[at : at + 2]) for at in (0, 3, 6)] == [frame[2], frame[5], frame[8]]
    assert easybus.request(1, easybus.VALUE) == bytes.fromhex("FE 00 3D")


def test_the_number_on_an_instrument_is_hexadecimal() -> None:
    (reply,) = Decoder().feed(bytes.fromhex("FE C5 68 CD 40 3C 8F 08 B2"))
    assert reply.code == easybus.IDENTITY
    assert f"{easybus.number_of(reply.body):x}" == "32407008"


@pytest.mark.parametrize(
    ("number", "value"),
    [
        (2 << 14 | 2176 + 2048, Value(21.76, None)),
        (1 << 14 | 2048 - 5, Value(-0.5, None)),
        (0x3FED, Value(None, "no sensor")),
        (0x3FFE, Value(None, "fault 16382")),
    ],
)
def test_a_value_of_one_group(number, value) -> None:
    assert easybus.value_of(bytes((~(number >> 8) & 0xFF, number & 0xFF))) == value


def test_what_is_no_value_is_none() -> None:
    assert easybus.value_of(b"") == Misread("a value of one group or two", "0 groups")
    assert easybus.value_of(bytes.fromhex("FE 05 71 00")) == Misread("a value of 0 to 7 decimals", "-15 decimals")


@given(hundredths=st.integers(-20000, 99999))
def test_what_the_simulated_thermometer_says_is_read_back(hundredths) -> None:
    (reply,) = Decoder().feed(easybus.reply(7, 0, easybus.body_of_value(hundredths / 100, 2)))
    assert reply.address == 7
    assert easybus.value_of(reply.body).value == hundredths / 100
