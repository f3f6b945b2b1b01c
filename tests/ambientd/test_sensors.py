"""Sensors as real files: one that goes is told once, looked for again by name, and holds up no other."""

import errno
import os
import threading

import pytest

from ambient_model.model import Input
from ambientd.notices import Notice
from ambientd.sources.sensor import Sensor
from ambientd.sources.sensors import Sensors
from ambientd.sources.supervision import Rules
from ambientd.sources.zone import Zone, ZoneTemperature

USB = Input("usb", "degC", "usb-therm", -20.0, 90.0)
BATTERY = Input("battery", "degC", "battery", -20.0, 70.0)


@pytest.fixture
def notes():
    return []


def zone_sensor(given, root):
    return Sensor(given, ZoneTemperature(Zone(given.zone), str(root), "/nowhere"))


@pytest.fixture
def make_sensors(phone, notes):
    """The two zones of the phone, under rules."""
    opened = []

    def make(rules=Rules(), inputs=(USB, BATTERY)):  # noqa: B008
        opened.append(Sensors([zone_sensor(each, phone.root) for each in inputs], rules, notes.append))
        return opened[-1]

    yield make
    for each in opened:
        each.close()


@pytest.fixture
def sensors(make_sensors):
    return make_sensors()


def temp(phone, number):
    return phone.root / f"class/thermal/thermal_zone{number}/temp"


def test_values_follow_the_files_in_the_order_of_the_sensors(sensors, phone, notes):
    assert sensors.read(0.0) == [30.0, 25.0]
    temp(phone, 10).write_text("-1500\n")
    assert sensors.read(1.0) == [-1.5, 25.0]
    assert notes == []


def test_one_that_goes_and_returns_is_told_once_each_and_leaves_the_other_alone(sensors, phone, notes):
    temp(phone, 3).write_text("\x1b[2J\n")
    assert [sensors.read(float(k)) for k in range(3)] == [[30.0, None]] * 3
    temp(phone, 3).write_text("26000\n")
    assert sensors.read(3.0) == [30.0, 26.0]
    assert notes == ["sensor battery: no value (its content is b'\\x1b[2J\\n')", "sensor battery: is back"]


@pytest.fixture
def failing(monkeypatch):
    """Let reads of the usb zone fail with an error; returns how often one was tried."""
    pread, tries = os.pread, []

    def fail(number):
        def read(descriptor, *rest):
            if os.readlink(f"/proc/self/fd/{descriptor}").endswith("thermal_zone10/temp"):
                tries.append(descriptor)
                if number:
                    raise OSError(number, os.strerror(number))
            return pread(descriptor, *rest)

        monkeypatch.setattr(os, "pread", read)
        return tries

    return fail


ERRORS = ["EAGAIN", "ENODATA", "ENXIO", "EIO", "ETIMEDOUT", "ENODEV", "EINVAL"]


@pytest.mark.parametrize("name", ERRORS)
def test_a_read_that_fails_is_missing_told_once_and_comes_back(sensors, notes, failing, name):
    number = getattr(errno, name)
    failing(number)
    assert [sensors.read(k / 10) for k in range(50)] == [[None, 25.0]] * 50
    failing(0)
    assert sensors.read(40.0) == [30.0, 25.0]
    assert notes == [f"sensor usb: no value ({os.strerror(number)})", "sensor usb: is back"]


@pytest.mark.parametrize("name", ["EIO", "ETIMEDOUT", "ENXIO"])
def test_a_read_that_keeps_failing_is_not_paid_for_at_every_tick(sensors, failing, name):
    tries = failing(getattr(errno, name))
    for k in range(1000):
        sensors.read(k / 10)
    assert len(tries) < 12


def test_doubles_are_noted_and_the_lowest_number_is_taken(phone, make_sensors, notes):
    phone.zone(11, "usb-therm", "99000\n")
    assert make_sensors(inputs=[USB]).read(0.0) == [30.0]
    assert notes == [f"sensor usb: 2 have this name, reading {temp(phone, 10)}"]


def test_a_value_outside_its_range_is_told_once_and_shown(sensors, phone, notes):
    temp(phone, 10).write_text("125000\n")
    assert [sensors.read(float(k)) for k in range(3)] == [[125.0, 25.0]] * 3
    temp(phone, 10).write_text("31000\n")
    sensors.read(3.0)
    assert notes == ["sensor usb: set aside (125 degC is outside -20 to 90)", "sensor usb: is back"]


def test_a_pipe_in_the_place_of_a_sensor_holds_up_nothing(phone, make_sensors, notes):
    temp(phone, 10).unlink()
    os.mkfifo(temp(phone, 10))
    assert make_sensors().read(0.0) == [None, 25.0]
    assert notes == ["sensor usb: no value (Illegal seek)"]


class Blocking:
    """os.pread that takes until it is told to be quick on the usb zone."""

    def __init__(self):
        self.quick = threading.Event()
        self.tries = []
        self._pread = os.pread

    def __call__(self, descriptor, *rest):
        if os.readlink(f"/proc/self/fd/{descriptor}").endswith("thermal_zone10/temp"):
            self.tries.append(threading.get_ident())
            self.quick.wait(60)
        return self._pread(descriptor, *rest)


@pytest.fixture
def blocking(monkeypatch):
    pread = Blocking()
    monkeypatch.setattr(os, "pread", pread)
    yield pread
    pread.quick.set()


def test_a_read_that_blocks_is_left_behind_and_never_waited_for_again(sensors, notes, blocking, until):
    """The second time it is tried in a thread that hangs until the end of the ticks."""
    assert [sensors.read(float(k)) for k in range(1000)] == [[None, 25.0]] * 1000
    until(lambda: len(blocking.tries) == 2)
    assert threading.get_ident() not in blocking.tries
    assert notes == ["sensor usb: no value (a reading takes more than 0.25 s)"]


def test_one_that_blocked_comes_back_when_it_is_quick(sensors, notes, blocking, until):
    assert sensors.read(0.0) == [None, 25.0]
    blocking.quick.set()
    now_s = iter(range(1, 100000))
    until(lambda: sensors.read(100.0 * next(now_s)) == [30.0, 25.0])
    assert sensors.read(1e9) == [30.0, 25.0]
    assert notes == ["sensor usb: no value (a reading takes more than 0.25 s)", "sensor usb: is back"]


def test_without_a_thread_to_spare_it_reads_by_itself(sensors, monkeypatch):
    def none_left(*_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("_thread.start_new_thread", none_left)
    assert [sensors.read(float(k)) for k in range(3)] == [[30.0, 25.0]] * 3


def test_descriptors_are_let_go(phone):
    before = len(os.listdir("/proc/self/fd"))
    sensors = Sensors([zone_sensor(each, phone.root) for each in (USB, BATTERY)], Rules(), print)
    temp(phone, 10).write_text("")
    for k in range(50):
        sensors.read(k * 100.0)
    sensors.close()
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
