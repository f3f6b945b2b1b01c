from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.protocols import agilent
from ambient_trainer.laboratory.protocols.agilent import Decoder, Scan
from ambient_trainer.laboratory.protocols.misread import Misread

READ = b"+2.61950000E+01,+2.62010000E+01,+2.60000000E+01\r\n"


@given(noise=st.binary(max_size=300))
def test_a_line_behind_any_noise_that_ended_is_read(noise) -> None:
    assert Decoder().feed(noise + b"\n" + READ)[-1] == Scan((26.195, 26.201, 26.0), None)


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
