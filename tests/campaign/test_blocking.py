"""A sensor whose driver blocks, for seconds or for ever, deaf to signals: it is left behind, and nothing else waits."""

import re
import subprocess
import sys

from processes import ran

from .conftest import PATIENT, Outputs

FOR_EVER_S = 1e6
PATIENCE_S = 0.25
"""The daemon's own."""


def test_one_that_blocks_is_done_without_until_it_answers(tracking, zones):
    """The others are read and all is published meanwhile, tick by tick."""
    descriptors = tracking.descriptors
    zones.fail("usb-therm", block_s=FOR_EVER_S)
    seen = []
    for k in range(300):
        zones.say("battery", 30000 + k)
        seen.append(tracking.step())
    assert {each["status"] for each in seen} == {"degraded"}
    assert [each["sensors"]["battery"]["used"] for each in seen] == [30 + k / 1000 for k in range(300)]
    assert zones.tries("usb-therm") == 2  # the first, and the one that waits for the driver to answer
    assert tracking.threads <= 4
    zones.heal("usb-therm")
    assert tracking.steps(150)[-1]["status"] == "tracking"
    assert (tracking.descriptors, tracking.threads) == (descriptors, 2)
    assert tracking.end() == [
        "ambientd: sensor usb: no value (a reading takes more than 0.25 s)",
        "ambientd: sensor usb: is back",
    ]


def test_check_names_one_that_blocks(device_library, config, clock, zones, tmp_path):
    zones.fail("battery", block_s=FOR_EVER_S)
    call = [sys.executable, "-m", "ambientd", "check", "--config", config(Outputs(tmp_path / "out"))]
    done = ran(*call, status=1, env={"LD_PRELOAD": str(device_library), "CAMPAIGN_CLOCK": str(clock.path)})
    assert "sensor battery: a reading takes more than 0.25 s" in done.stderr
    assert "usb, " in done.stdout


def test_ticks_that_slow_sensors_do_not_leave_time_for_are_reported_and_counted(
    device_library, config, zones, tmp_path
):
    """On the real clock, at 10 Hz, with 0.2 s a reading."""
    outputs = Outputs(tmp_path / "out")
    for kind in ("usb-therm", "battery", "cpu-0-0"):
        zones.fail(kind, block_s=0.2)
    call = [sys.executable, "-c", PATIENT.format(30.0), "run", "--config", config(outputs, rate_hz=10)]
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True, env={"LD_PRELOAD": str(device_library)}) as daemon:
        daemon.stderr.readline()
        line = daemon.stderr.readline()
        report = outputs.status()
        daemon.terminate()
        assert daemon.wait(30) == 0
    missed = int(re.search(r"ticks cannot be held, (\d+) of 50 ", line)[1])
    assert missed > 20
    assert report["missed_ticks"] >= missed
