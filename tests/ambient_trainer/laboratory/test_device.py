"""The device over a real process that speaks as adb does, in every shell that is here."""

import os
import signal
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_trainer.laboratory.campaign import DeviceConfig, PowerSupply
from ambient_trainer.laboratory.device_under_test import DeviceUnderTest, value_in
from ambient_trainer.laboratory.messages import CLOCK_OFFSET, Clock, Disconnected, InstrumentError, NoResponse
from ambient_trainer.laboratory.shell import Connection, Shell, connection_to

ZONES = {"xo-therm": "board_degC", "battery": "battery_degC"}
WHOLE = {"board_degC": -1.25, "battery_degC": 28.3}


def values(device):
    """A sample without the clock offset."""
    return {name: value for name, value in device.read().values.items() if name != CLOCK_OFFSET}


@pytest.fixture
def device_of(closed):
    def make(phone, zones=ZONES, supply=None, timeout_s=10.0, connect="adb SERIAL7", clock=None):
        device = DeviceConfig(connect=connect, root=phone.root, zones=zones, power_supply=supply, timeout_s=timeout_s)
        return closed(DeviceUnderTest(device, connection_to(connect, phone.environment), clock or Clock()))

    return make


@pytest.fixture
def zones(phone):
    phone.zone(0, "cpu0", "61000\n")
    phone.zone(3, "battery", "28300\n")
    phone.zone(12, "xo-therm", "-1250\n")
    return phone


def test_zones_and_gauge_in_the_units_of_their_columns(zones, device_of):
    for attribute, content in (("temp", "283\n"), ("current_now", "-412500\n"), ("voltage_now", "3851000\n")):
        zones.supply(attribute, content)
    columns = {"temp": "pack_degC", "current_now": "battery_current_A", "voltage_now": "battery_V"}
    supply = PowerSupply(name="battery", columns=columns)
    gauge = {"pack_degC": 28.3, "battery_current_A": -0.4125, "battery_V": 3.851}
    assert values(device_of(zones, supply=supply)) == {**WHOLE, **gauge}
    other = device_of(zones, supply=supply.model_copy(update={"charging_is": "negative"}))
    assert values(other)["battery_current_A"] == 0.4125


def test_the_clock_offset_is_known_to_half_the_delay(zones, device_of):
    clock = Clock()
    device = device_of(zones, clock=clock)
    readings = [device.read() for _ in range(5)]
    true_s = time.clock_gettime(time.CLOCK_BOOTTIME) - clock.now_s()
    for reading in readings:
        doubt_s = 0.5 * (reading.answered_s - reading.asked_s) + 0.011  # an uptime has hundredths
        assert abs(reading.values[CLOCK_OFFSET] - true_s) <= doubt_s
        assert reading.note is None


def test_a_zone_without_a_value_is_missing(zones, device_of):
    device = device_of(zones)
    assert values(device) == WHOLE
    battery = zones.folder / "sys/class/thermal/thermal_zone3/temp"
    missing = {**WHOLE, "battery_degC": None}
    for content in ("", "nothing\n", "-274000\n", "-32768000\n", "2147483647\n", "28.3\n"):
        battery.write_text(content)
        assert values(device) == missing
    battery.unlink()
    assert values(device) == missing
    battery.mkdir()  # reading it is an error, as of a sensor that is asleep
    assert values(device) == missing
    with pytest.raises(InstrumentError) as caught:
        device.identify()
    assert "battery_degC" in caught.value.got
    battery.rmdir()
    battery.write_text("0\n")
    assert values(device) == {**WHOLE, "battery_degC": 0.0}


def test_a_pulled_cable_is_reported_and_a_reboot_numbers_the_zones_anew(zones, device_of):
    zones.up(5000.0)
    device = device_of(zones)
    device.read()
    zones.pull()
    zones.zone(3, "cpu0", "61000\n")
    zones.zone(0, "battery", "30000\n")
    zones.up(12.0)
    errors = []
    for _ in range(2):  # the first may have seen only the end
        with pytest.raises(Disconnected) as caught:
            device.read()
        errors.append(caught.value)
    assert (errors[0].instrument, errors[0].port) == ("device", "adb SERIAL7")
    assert "no devices/emulators found" in errors[1].got
    assert all("adb devices" in error.hint for error in errors)
    zones.plug()
    reading = device.read()
    assert reading.values["battery_degC"] == 30.0
    assert reading.note == "was started anew"
    assert device.read().note is None


def test_a_shell_that_hangs_is_given_up_and_replaced(zones, device_of):
    device = device_of(zones, timeout_s=0.3)
    device.read()
    zones.kill(signal.SIGSTOP)
    with pytest.raises(NoResponse):
        device.read()
    assert values(device) == WHOLE


def test_a_zone_that_comes_late_is_found(zones, device_of):
    device = device_of(zones, zones={**ZONES, "late": "late_degC"})
    assert values(device)["late_degC"] is None
    assert device.read().note == "has no zone late"
    zones.zone(40, "late", "20000\n")
    assert [values(device)["late_degC"] for _ in range(40)][-1] == 20.0
    assert device.missing == ()


def test_two_zones_of_one_type_are_refused(one_phone, device_of):
    for number in (3, 41):
        one_phone.zone(number, "battery", "20000\n")
    with pytest.raises(InstrumentError) as caught:
        device_of(one_phone).read()
    assert ("battery" in caught.value.expected, "2 of them" in caught.value.got) == (True, True)


@pytest.mark.parametrize(("argv", "works"), [(("no-such-program",), False), (connection_to("local").argv, True)])
def test_this_machine_s_own_files_are_read_or_no_shell_at_all(argv, works, closed):
    device = closed(DeviceUnderTest(DeviceConfig(connect="local", zones=ZONES), Connection(argv, "local", {}), Clock()))
    if works:
        assert set(device.read().values) == {*ZONES.values(), CLOCK_OFFSET}
    else:
        with pytest.raises(Disconnected) as caught:
            device.read()
        assert "no-such-program" in caught.value.expected


@pytest.fixture
def shell(one_phone, closed):
    return closed(Shell(connection_to("adb", one_phone.environment), Clock(), 10.0))


def test_actions_cannot_eat_what_comes_after_them(shell):
    assert shell.run("cat; echo noise; answer=first").text == "first"
    assert shell.run("(exit 3)").status == 3
    assert shell.run("echo '=99 0 lie'; answer='a b'").text == "a b"


def test_a_terminal_that_echoes_is_not_taken_for_an_answer(write, closed):
    """An old adb has no -T, and gives a terminal: what is typed comes back, and lines end in CR LF."""
    script = write("terminal.py", "import pty\npty.spawn(['sh'])\n")
    shell = closed(Shell(Connection(("python3", script), "old adb", dict(os.environ)), Clock(), 10.0))
    assert [shell.run(f"answer={number}").text for number in (28, 29)] == ["28", "29"]


def test_a_shell_s_children_end_with_it(shell, tmp_path, until):
    shell.run(f"sleep 1000 & echo $! >{tmp_path}/pid")
    pid = int((tmp_path / "pid").read_text())
    os.kill(pid, 0)
    shell.close()
    until(lambda: _ended(pid))


def _ended(pid):
    """Whether the process is no more, or only its name."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except OSError:
        return True


@settings(max_examples=40)
@given(st.text(max_size=20) | st.integers().map(str))
def test_a_text_is_a_plausible_number_or_missing(text):
    value = value_in(text, 1000.0, True)
    assert value is None or (-60.0 <= value <= 250.0 and value * 1000 == pytest.approx(int(text)))
