"""Sensors of this machine, from files as the kernel's documentation has them."""

import contextlib
import os
import threading
import time

import numpy as np
import pytest

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.host_sensors import Driver
from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError, NoResponse
from refusals import refused

W1 = "bus/w1/devices/28-0316a279d1ff/w1_slave"
IIO = "bus/iio/devices/iio:device3/in_temp"
GOOD = "72 01 4b 46 7f ff 0e 10 57 : crc=57 {}\n72 01 4b 46 7f ff 0e 10 57 t={}\n"
# as they stand under /sys: the channel, the files there, and the temperature or what the reason names
SENSORS = [
    ("28-0316a279d1ff", {W1: GOOD.format("YES", 23125)}, 23.125),
    ("28-0316a279d1ff", {W1: GOOD.format("NO", 23125)}, "check"),
    ("28-0316a279d1ff", {W1: GOOD.format("YES", 85000)}, "85 degC"),
    ("bus/w1/devices/28-*/temperature", {W1.replace("w1_slave", "temperature"): "-1250\n"}, -1.25),
    ("bus/iio/devices/iio:device0/in_temp_input", {"bus/iio/devices/iio:device0/in_temp_input": "21870\n"}, 21.87),
    ("bus/iio/devices/iio:device*/in_temp_raw", {f"{IIO}_raw": "2200\n", f"{IIO}_scale": "10\n"}, 22.0),
    ("bus/iio/devices/iio:device*/in_temp_raw", {f"{IIO}_raw": "2200\n", f"{IIO}_offset": "-2100\n"}, 0.1),
    ("class/hwmon/hwmon*/temp1_input", {f"class/hwmon/hwmon{k}/temp1_input": "20000\n" for k in (1, 2)}, "2 files"),
    ("class/hwmon/hwmon*/temp1_input", {"class/hwmon/hwmon4/temp1_input": "-274000\n"}, "-274 degC"),
    ("class/hwmon/hwmon*/temp1_input", {"class/hwmon/hwmon4/temp1_input": "\n"}, "float"),
    ("class/hwmon/hwmon*/temp1_input", {"class/hwmon/hwmon4/temp1_input": "20"}, "cut"),
    ("class/hwmon/hwmon*/temp1_input", {}, "0 files"),
]
WELL = "class/thermal/well"


def driver(root, probes, offsets=None, **values):
    return Driver(settings("host-sensors", port=str(root), probes=probes, **values), Clock(), offsets)


def put(root, name, text):
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).write_text(text)


@pytest.mark.parametrize(("channel", "files", "expected"), SENSORS)
def test_a_sensor_is_read_in_its_own_form_or_has_a_reason(tmp_path, channel, files, expected):
    for name, text in {WELL: "20000\n", **files}.items():
        put(tmp_path, name, text)
    reading = driver(tmp_path, {"air": channel, "well": WELL}).read()
    value = reading.values["probe_air_degC"]
    assert (expected in reading.note) if value is None else (value, reading.note) == (pytest.approx(expected), None)
    assert reading.values["probe_well_degC"] == 20.0


def test_offsets_are_added_and_without_any_temperature_it_is_an_error(tmp_path):
    put(tmp_path, WELL, "20000\n")
    offset = ProbeOffset.model_validate({"points": [{"reading_degC": 0.0, "offset_K": 0.5, "standard_error_K": 0.0}]})
    sensors = driver(tmp_path, {"well": WELL}, {"well": offset})
    assert sensors.read().values == {"probe_well_degC": 20.5}
    (tmp_path / WELL).unlink()
    with pytest.raises(Disconnected, match="well: 0 files"):
        sensors.read()


def test_a_sensor_that_is_late_is_missing_until_it_answers_anew(tmp_path):
    put(tmp_path, WELL, "20000\n")
    os.mkfifo(tmp_path / "class/slow")
    sensors = driver(tmp_path, {"slow": "class/slow", "well": WELL}, timeout_s=0.1)
    for _ in range(2):
        reading = sensors.read()
        assert (reading.values["probe_slow_degC"], reading.note) == (None, "slow: no answer in time")
    with open(tmp_path / "class/slow", "w") as slow:
        slow.write("30000\n")  # to the question that was given up
    (tmp_path / "class/slow").unlink()
    put(tmp_path, "class/slow", "31000\n")
    while (value := sensors.read().values["probe_slow_degC"]) is None:
        pass
    assert value == 31.0
    (tmp_path / "class/slow").unlink()
    os.mkfifo(tmp_path / "class/slow")
    alone = driver(tmp_path, {"slow": "class/slow"}, timeout_s=0.1)
    with pytest.raises(NoResponse):
        alone.read()
    with open(tmp_path / "class/slow", "w"):
        """So that its thread ends."""


def test_whatever_a_bus_answers_no_reading_is_wrong(tmp_path):
    """A conversion takes its time, and a tenth of the answers each is late, cut, of a wrong check, or of a start."""
    path, random, stop = tmp_path / W1, np.random.default_rng(0), threading.Event()
    path.parent.mkdir(parents=True)
    os.mkfifo(path)

    def bus():
        while not stop.is_set():
            with contextlib.suppress(BrokenPipeError), open(path, "w") as asked:
                way = random.choice(["late", "cut", "check", "start", ""], p=[0.1, 0.1, 0.1, 0.1, 0.6])
                time.sleep(0.15 if way == "late" else 0.01)
                text = GOOD.format("NO" if way == "check" else "YES", 85000 if way == "start" else round(1e6 * now_s()))
                asked.write(text[: random.integers(len(text))] if way == "cut" else text)
            time.sleep(0.002)  # until the reader has gone

    began_s = time.monotonic()
    now_s = lambda: 0.02 * (time.monotonic() - began_s)  # noqa: E731  # the temperature is the time
    thread = threading.Thread(target=bus)
    thread.start()
    sensors, known = driver(tmp_path, {"air": "28-0316a279d1ff"}, timeout_s=0.1), 0
    for _ in range(150):
        before_degC = 1000.0 * now_s()
        with contextlib.suppress(InstrumentError):
            assert before_degC - 0.001 <= sensors.read().values["probe_air_degC"] <= 1000.0 * now_s()
            known += 1
        time.sleep(0.02)
    stop.set()
    with open(path):
        thread.join()
    assert 20 < known < 120


@pytest.mark.parametrize("channel", ["/etc/passwd", "../class/slow", ""])
def test_a_channel_outside_is_refused(tmp_path, channel):
    assert "probes.a" in str(refused(driver, tmp_path, {"a": channel}))
