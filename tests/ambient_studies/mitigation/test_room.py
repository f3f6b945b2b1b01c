"""Rooms as a user writes them, and their air."""

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.mitigation.setting import Room, room_of


@pytest.mark.parametrize(("text", "temps"), [("5", (5.0,)), ("-3.5", (-3.5,)), ("35/5/35", (35.0, 5.0, 35.0))])
def test_a_room_is_read_and_named_as_it_is_written(text, temps):
    assert room_of(text) == Room(temps)
    assert room_of(text).name == text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("warm", "--room: 'warm' is no temperature; write 5, or 35/5/35 for a walk"),
        ("5//5", "--room: '5//5' is no temperature; write 5, or 35/5/35 for a walk"),
        ("nan", "--room: nan lies outside -20 to 60 degC; choose temperatures in this range"),
        ("20/61", "--room: 20/61 lies outside -20 to 60 degC; choose temperatures in this range"),
    ],
)
def test_what_is_no_room_is_refused(text, message):
    with pytest.raises(Refused) as refused:
        room_of(text)
    assert str(refused.value) == message


def test_each_room_has_its_part_and_the_first_the_time_before():
    air = Room((35.0, 5.0, 20.0)).air_degC(600, 600 + 3 * 1200, 1.0, np.random.default_rng(1))
    for start, stop, temp in ((0, 1800, 35.0), (1900, 3000, 5.0), (3100, 4200, 20.0)):
        assert np.abs(air[start:stop] - temp).max() < 1.2
        assert air[start:stop].mean() == pytest.approx(temp, abs=0.2)
    # through the door: 63 % of the way in 20 s
    assert air[1820] == pytest.approx(35 - 30 * (1 - np.exp(-1)), abs=1.5)


def test_draughts_do_not_depend_on_the_period():
    for period_s in (0.5, 5.0):
        air = Room((20.0,)).air_degC(0, 200_000, period_s, np.random.default_rng(2))
        assert air.std() == pytest.approx(0.2, rel=0.05)
