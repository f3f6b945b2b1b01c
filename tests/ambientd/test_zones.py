"""A zone file's bytes are a temperature or nothing; a lost zone is found again by its type."""

import os
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambientd.notices import Notice
from ambientd.sources.zones import Zones, ZoneSensor, find_zones, temperature_degC


@settings(derandomize=True, deadline=None)
@given(st.integers(-273150, 10**9), st.sampled_from([b"", b"\n", b" \n"]))
def test_millidegrees_become_degrees(millidegrees, end):
    value = temperature_degC(str(millidegrees).encode() + end)
    assert value is not None
    assert abs(Fraction(value) - Fraction(millidegrees, 1000)) < Fraction(1, 10**6)


@settings(derandomize=True, deadline=None)
@given(st.binary(max_size=48))
def test_any_bytes_are_a_believable_temperature_or_missing(content):
    value = temperature_degC(content)
    assert value is None or value >= -273.15


@pytest.mark.parametrize(
    "content",
    [b"", b"\n", b"-", b"nan", b"1e3", b"26.5", b"0x1F", b"1_000", b"+5", b"12 13", b"25000\n26000\n", b"-32768000\n",
     b"-274000\n", b"9" * 32, "٣٤".encode()],
)  # fmt: skip
def test_what_is_no_temperature_is_missing(content):
    assert temperature_degC(content) is None


def test_zones_are_found_by_type_in_the_order_of_their_numbers(sysfs):
    for number, kind in ((10, "usb-therm"), (2, "usb-therm"), (1, "battery")):
        sysfs.zone(number, kind, "1\n")
    (sysfs.root / "class/thermal/cooling_device0").mkdir()
    (sysfs.root / "class/thermal/thermal_zone7").mkdir()  # without a type
    folder = f"{sysfs.root}/class/thermal"
    assert find_zones(str(sysfs.root)) == {
        "battery": [f"{folder}/thermal_zone1"],
        "usb-therm": [f"{folder}/thermal_zone2", f"{folder}/thermal_zone10"],
    }


def test_no_thermal_class_is_no_zones(tmp_path):
    assert find_zones(str(tmp_path)) == {}


@pytest.fixture
def notes():
    return []


@pytest.fixture
def zones(phone, notes):
    opened = Zones(str(phone.root), [ZoneSensor("usb", "usb-therm"), ZoneSensor("battery", "battery")], notes.append)
    yield opened
    opened.close()


def temp(phone, number):
    return phone.root / f"class/thermal/thermal_zone{number}/temp"


def test_values_follow_the_files_in_the_order_of_the_sensors(zones, phone, notes):
    assert zones.read(0.0) == [30.0, 25.0]
    temp(phone, 10).write_text("-1500\n")
    assert zones.read(1.0) == [-1.5, 25.0]
    assert notes == []


def test_one_that_goes_and_returns_is_told_once_each_and_leaves_the_other_alone(zones, phone, notes):
    temp(phone, 3).write_text("-274000\n")
    assert [zones.read(float(k)) for k in range(3)] == [[30.0, None]] * 3
    temp(phone, 3).write_text("26000\n")
    assert zones.read(3.0) == [30.0, 26.0]
    assert notes == ["sensor battery: no value (it says b'-274000\\n')", "sensor battery: is back"]


def test_a_read_that_fails_is_missing_and_tried_again_at_the_next_tick(zones, monkeypatch, notes):
    pread = os.pread

    def fail(*_):
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "pread", fail)
    assert zones.read(0.0) == [None, None]
    monkeypatch.setattr(os, "pread", pread)
    assert zones.read(0.1) == [30.0, 25.0]
    assert notes[0] == "sensor usb: no value (Resource temporarily unavailable)"


def test_a_zone_that_moves_to_another_number_is_found_again_at_once(zones, phone):
    """As a driver's new start does it: the old file has nothing more to say."""
    assert zones.read(0.0) == [30.0, 25.0]
    temp(phone, 10).write_text("")
    (phone.root / "class/thermal/thermal_zone10").rename(phone.root / "gone")
    phone.zone(4, "usb-therm", "31000\n")
    assert zones.read(1.0) == [31.0, 25.0]


def test_a_zone_that_stays_away_is_looked_for_less_and_less_often(zones, phone, monkeypatch):
    looks = []
    now = 0.0
    temp(phone, 10).write_text("")
    monkeypatch.setattr("ambientd.sources.zones.find_zones", lambda root: looks.append(now) or {})
    for k in range(200):
        now = float(k)
        zones.read(now)
    assert looks == [0.0, 1.0, 3.0, 7.0, 15.0, 31.0, 63.0, 95.0, 127.0, 159.0, 191.0]


def test_a_zone_that_comes_after_the_start_is_taken(sysfs, notes):
    zones = Zones(str(sysfs.root), [ZoneSensor("usb", "usb-therm")], notes.append)
    assert zones.read(0.0) == [None]
    sysfs.zone(0, "usb-therm", "20000\n")
    assert zones.read(1.0) == [20.0]
    zones.close()
    assert notes == ["sensor usb: no value (no thermal zone of type 'usb-therm')", "sensor usb: is back"]


def test_doubles_are_noted_and_the_lowest_number_is_taken(phone, notes):
    phone.zone(11, "usb-therm", "99000\n")
    zones = Zones(str(phone.root), [ZoneSensor("usb", "usb-therm")], notes.append)
    assert zones.read(0.0) == [30.0]
    zones.close()
    folder = f"{phone.root}/class/thermal/thermal_zone10"
    assert notes == [f"sensor usb: 2 zones of type 'usb-therm', taking {folder}"]


def test_descriptors_are_let_go(phone):
    before = len(os.listdir("/proc/self/fd"))
    zones = Zones(str(phone.root), [ZoneSensor("usb", "usb-therm")], print)
    temp(phone, 10).write_text("")
    for k in range(50):
        zones.read(k * 100.0)
    zones.close()
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_flapping_sensor_does_not_flood_the_log():
    notice = Notice()
    told = [k for k in range(1200) if notice.changed(float(k), k % 2 == 0)]
    assert len(told) <= 12 + 1
    assert told[:6] == [0, 1, 2, 3, 4, 5]


def test_what_stays_wrong_while_the_log_was_quiet_is_told_in_the_end():
    notice = Notice()
    for k in range(40):
        notice.changed(float(k), k % 2 == 0)
    assert [k for k in range(40, 1000) if notice.changed(float(k), True)] == [600]
