"""Android's sensor: the sub-HAL is compiled, loaded as the Multi-HAL loads it, and follows the real daemon.

It compiles against stand-ins for AOSP's headers, in ``sensors``. Where AMBIENTD_SENSORS_MULTIHAL, or the folder beside
this repository, holds the Multi-HAL's own (``include/V2_1/SubHal.h``), against those too; what hidl-gen makes of the
interface's description stays a stand-in.
"""

import itertools
import json
import os
import re
import shutil
import socket
import subprocess
from pathlib import Path

import pytest

from processes import ran

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
SENSORS = DEPLOY / "android" / "sensors"
STAND_INS = Path(__file__).with_name("sensors")
MULTIHAL = Path(os.environ.get("AMBIENTD_SENSORS_MULTIHAL", DEPLOY.parents[1] / "shared/consumers/sensors-multihal"))
BAD_VALUE, INVALID_OPERATION = -22, -38


@pytest.fixture(scope="module", params=["stand-ins", "AOSP's SubHal.h"])
def compiled(request, tmp_path_factory):
    """The sub-HAL and the harness that drives it, compiled; the socket that it follows."""
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    real = MULTIHAL / "include"
    if request.param != "stand-ins" and not (real / "V2_1" / "SubHal.h").is_file():
        pytest.skip("the Multi-HAL's headers are not in AMBIENTD_SENSORS_MULTIHAL")
    folder = tmp_path_factory.mktemp("sensors")
    for name in ("2.0/types.h", "2.1/types.h", "2.1/ISensors.h"):
        header = folder / "generated" / "android" / "hardware" / "sensors" / name
        header.parent.mkdir(parents=True, exist_ok=True)
        header.write_text(f'#include "{STAND_INS / "hidl.h"}"\n')
    own = folder / "own" / "V2_1" / "SubHal.h"
    own.parent.mkdir(parents=True)
    own.write_text(f'#include "{STAND_INS / "SubHal.h"}"\n')
    headers = own.parents[1] if request.param == "stand-ins" else real
    flags = ["-std=c++17", "-Wall", "-Werror", f"-I{folder / 'generated'}", f"-isystem{headers}"]
    place = folder / "socket"
    library, harness = folder / "sensors.ambientd.so", folder / "harness"
    # as Android compiles: without exceptions
    hal = ["-fno-exceptions", "-fPIC", "-shared", f'-DAMBIENTD_SOCKET="{place}"']
    for options, source, target in (
        (hal, SENSORS / "AmbientSubHal.cpp", library),
        (["-rdynamic"], STAND_INS / "harness.cpp", harness),
    ):
        ran("g++", *flags, *options, source, "-o", target, "-ldl", "-pthread", timeout=300)
    return harness, library, place


class Hal:
    """The loaded sub-HAL, called as the Multi-HAL calls it."""

    def __init__(self, process, log):
        self._process, self._log = process, log

    def lines(self):
        return self._log.read_text().splitlines()

    def call(self, what, until):
        """The result of a call, which the harness prints last."""
        before = len(self.lines())
        self._process.stdin.write(f"{what}\n")
        self._process.stdin.flush()
        name = what.split()[0]
        until(lambda: any(line.startswith(f"{name} ") for line in self.lines()[before:]))
        return int(next(line for line in self.lines()[before:] if line.startswith(f"{name} ")).split()[1])

    def events(self, kind):
        """Values and times in s of the events of a type, so far."""
        found = [
            re.fullmatch(r"event type=(\d+) handle=1 value=(\S+) at=(\d+) locked=0", line) for line in self.lines()
        ]
        return [(float(each[2]), int(each[3]) / 1e9) for each in found if each and int(each[1]) == kind]

    def values(self):
        return [value for value, _ in self.events(13)]

    def state(self, until):
        """What ``debug`` says."""
        self.call("debug", until)
        return next(line for line in reversed(self.lines()) if "active, " in line)


@pytest.fixture
def hal(compiled, spawn, until, tmp_path):
    harness, library, _ = compiled
    log = tmp_path / "hal.log"
    with log.open("w") as output:
        process = spawn([str(harness), str(library)], stdin=subprocess.PIPE, stdout=output)
    made = Hal(process, log)
    until(lambda: made.lines() == ["loaded ambientd version=0x2010000"])
    assert made.call("initialize", until) == 0
    yield made
    process.stdin.close()


def test_it_is_one_on_change_sensor_that_every_app_may_read(hal, until):
    hal.call("list", until)
    [line] = [line for line in hal.lines() if line.startswith("sensor ")]
    assert line == (
        "sensor handle=1 type=13 android.sensor.ambient_temperature flags=2 permission='' delay=100000..60000000 fifo=0"
    )


def test_the_events_follow_the_daemon_and_none_comes_of_a_fault_or_a_death(
    hal, compiled, weather, spawn, deployed, model_file, until
):
    """The daemon with Android's form of publication, on the trace that the test writes."""

    def meanwhile(degC, condition):
        """The daemon ticks, a second of its trace at a time."""
        until(lambda: weather.say(degC, rows=1) or condition())

    run = deployed("run", "--model", model_file, "--replay", weather.trace, "--speed", "0", "--publish")
    weather.start(spawn, [*run, f"socket:{compiled[2]}"], ambient_degC=23.0)
    assert hal.call("batch 200000000", until) == 0
    assert hal.values() == [], "nothing before it is activated"
    hal.call("activate 1", until)
    meanwhile(23.0, lambda: hal.values() == [23.0])
    meanwhile(26.0, lambda: hal.values()[-1] == pytest.approx(26.0, abs=0.1))
    values, times_s = zip(*hal.events(13))
    assert all(abs(after - before) >= 0.0999 for before, after in itertools.pairwise(values))
    assert all(after - before >= 0.2 for before, after in itertools.pairwise(times_s)), "no faster than asked for"
    meanwhile(None, lambda: "no estimate" in hal.state(until))
    reported = hal.values()
    assert all(23.0 <= value <= 26.1 for value in reported), "no poison, no zero"
    meanwhile(28.0, lambda: hal.values()[-1] == pytest.approx(28.0, abs=0.1))
    weather.kill()
    until(lambda: "active, not connected, no estimate" in hal.state(until))
    reported = hal.values()
    hal.call("flush", until)
    assert (hal.values(), len(hal.events(0))) == (reported, 1)


def test_a_flush_is_answered_and_what_it_has_not_is_refused(hal, until):
    assert hal.call("flush", until) == BAD_VALUE, "it is not active"
    assert hal.call("activate 1 2", until) == BAD_VALUE
    assert hal.call("batch 1000000000 2", until) == BAD_VALUE
    assert hal.call("activate 1", until) == 0
    assert hal.call("flush 0 2", until) == BAD_VALUE
    assert hal.call("flush", until) == 0
    assert [value for value, _ in hal.events(0)] == [1.0], "META_DATA_FLUSH_COMPLETE"
    assert hal.call("inject 30", until) == INVALID_OPERATION
    assert hal.call("channel", until) == INVALID_OPERATION
    assert hal.call("mode 1", until) == 0, "or the Multi-HAL refuses it to every sensor"
    assert hal.call("activate 0", until) == 0
    assert hal.values() == []


def test_what_is_no_trusted_number_is_no_event(hal, compiled, until):
    compiled[2].unlink(missing_ok=True)
    daemons = socket.create_server(str(compiled[2]), family=socket.AF_UNIX)
    daemons.settimeout(20)
    hal.call("batch 100000000", until)
    hal.call("activate 1", until)
    with daemons.accept()[0] as daemon:
        for text in (b"null", b"NaN", b"-Infinity", b'"23"', b"1e9", b"23 4", b""):
            daemon.send(b'{"time_s": 1, "ambient_degC": ' + text + b', "low_degC": 20}\n')
        daemon.send(b'{"degC": 23.0}\n\n{"model": "\\"ambient_degC\\": 24.0,", "ambient_degC": null}\n')
        daemon.send(b'{"time_s": 2, "ambient_degC": 25.0')
        until(lambda: "connected, no estimate" in hal.state(until))
        daemon.send(b', "low_degC": 24}\n')
        until(lambda: hal.values() == [25.0])
        daemon.send(b'{"ambient_degC": 25.04}\n')
        until(lambda: "25.040 degC" in hal.state(until))
        hal.call("activate 0", until)
        assert (hal.call("flush", until), hal.values()) == (BAD_VALUE, [25.0])
        hal.call("activate 1", until)
    with daemons, daemons.accept()[0] as daemon:
        daemon.send(b'{"ambient_degC": 25.04}\n')
        until(lambda: hal.values() == [25.0, pytest.approx(25.04)], "who asks anew is told what is not new")
        daemon.send(b'{"ambient_degC": -5.5}\n')
        until(lambda: hal.values()[2:] == [-5.5])
        daemon.sendall(b"x" * 70_000)
        until(lambda: daemon.recv(1) == b"", "a line without an end is not kept")
    # a new start of Android's framework leaves nothing active
    assert hal.call("initialize", until) == 0
    assert "inactive, not connected, no estimate" in hal.state(until)


def test_the_build_names_what_is_here_and_the_socket_that_android_s_configuration_publishes():
    build = (SENSORS / "Android.bp").read_text()
    [name] = re.findall(r'^    name: "(.*)",$', build, re.MULTILINE)
    assert (SENSORS / "hals.conf").read_text() == f"{name}.so\n"
    assert re.findall(r'srcs: \["(.*)"\]', build) == [each.name for each in SENSORS.glob("*.cpp")]
    [place] = re.findall(r'-DAMBIENTD_SOCKET=\\"(.*)\\"', build)
    assert f"socket:{place}" in json.loads((DEPLOY / "android" / "ambientd.json").read_text())["publish"]
