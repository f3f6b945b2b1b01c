"""Sensors as real files: one that goes is told once, looked for again by name, and holds up no other."""

import os

import pytest

from ambientd.config import settings_for_model
from ambientd.notices import Notice
from ambientd.sources.sensor import Sensor
from ambientd.sources.sensors import Sensors
from ambientd.sources.supervision import Rules
from ambientd.sources.zone import Zone

from .conftest import BATTERY, USB


@pytest.fixture
def notes():
    return []


@pytest.fixture
def sensors(phone, notes):
    """The two zones of the phone."""
    settings = settings_for_model("m")._replace(sysfs_root=str(phone.root), zones_by_name="/nowhere")
    made = Sensors([Sensor(each, Zone(each.zone), settings) for each in (USB, BATTERY)], Rules(), notes.append)
    yield made
    made.close()


def temp(phone, number):
    return phone.root / f"class/thermal/thermal_zone{number}/temp"


@pytest.mark.parametrize(
    ("number", "content", "read", "note"),
    [
        (3, "\x1b[2J\n", [30.0, None], "sensor battery: no value (its content is b'\\x1b[2J\\n')"),
        (10, "31\n", [None, 25.0], "sensor usb: set aside (reports degrees: 31 degC taken for 0.031)"),
        (10, "125000\n", [125.0, 25.0], "sensor usb: set aside (125 degC is outside -20 to 90)"),
    ],
)
def test_one_that_is_wrong_and_returns_is_told_once_each_and_leaves_the_other_alone(
    sensors, phone, notes, number, content, read, note
):
    right = temp(phone, number).read_text()
    temp(phone, number).write_text(content)
    assert [sensors.read(float(k)) for k in range(3)] == [read] * 3
    temp(phone, number).write_text(right)
    assert sensors.read(3.0) == [30.0, 25.0]
    assert notes == [note, f"{note.split(': ')[0]}: is back"]


def test_a_pipe_in_the_place_of_a_sensor_holds_up_nothing(phone, notes, request):
    temp(phone, 10).unlink()
    os.mkfifo(temp(phone, 10))
    sensors = request.getfixturevalue("sensors")  # which opens what is there now
    assert sensors.read(0.0) == [None, 25.0]
    assert notes == ["sensor usb: no value (Illegal seek)"]


def test_a_flapping_sensor_does_not_flood_the_log_and_what_stays_wrong_is_told_in_the_end():
    notice = Notice()
    told = [k for k in range(1200) if notice.changed(float(k), k % 2 == 0)]
    assert len(told) <= 12 + 1
    assert told[:6] == [0, 1, 2, 3, 4, 5]
    notice = Notice()
    for k in range(40):
        notice.changed(float(k), k % 2 == 0)
    assert [k for k in range(40, 1000) if notice.changed(float(k), True)] == [600]
