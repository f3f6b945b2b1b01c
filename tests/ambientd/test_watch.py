"""``ambientd watch`` on real daemons: a line a tick, over their restarts, and a word when nothing comes."""

import os
import signal
import sys

import pytest

from ambientd.client import Reading, Sensor
from ambientd.watch import as_text
from processes import ran


@pytest.fixture
def daemon(start, until, on_phone, path):
    """Start a daemon at 20 Hz and wait for its socket."""

    def started():
        process = start(*on_phone(f"socket:{path}"))
        until(lambda: os.path.exists(path))
        return process

    return started


def test_it_tells_people_each_tick_and_goes_on_with_the_next_daemon(start, ended, daemon, phone, path):
    (phone.root / "class/thermal/thermal_zone3/temp").write_text("24500\n")
    first = daemon()
    watcher = start("watch", path)
    lines = [watcher.stdout.readline() for _ in range(6)]
    assert lines[0].split(" s  ")[1] == "warming_up  22.60 degC (22.10 to 23.35, 90 %)  usb 30.00  battery 24.50\n"
    assert lines[0] < lines[5]  # shown to a tenth of a second: two ticks
    assert ended(first)[0] == 0
    assert watcher.stderr.readline() == f"ambientd: {path}: the daemon has ended; waiting for the next\n"
    second = daemon()
    assert watcher.stderr.readline() == f"ambientd: {path}: it is back\n"
    second.kill()
    second.wait()
    assert watcher.stderr.readline() == f"ambientd: {path}: the daemon has ended; waiting for the next\n"
    status, _, log = ended(watcher, signal.SIGINT)
    assert (status, log) == (0, "")


def test_it_says_once_when_nothing_comes_and_when_it_is_back(start, ended, daemon, path):
    stopped = daemon()
    watcher = start("watch", path, "--stale-after", "0.5")
    watcher.stdout.readline()
    os.kill(stopped.pid, signal.SIGSTOP)
    assert watcher.stderr.readline() == f"ambientd: {path}: nothing has come for 0.5 s; the last reading is stale\n"
    os.kill(stopped.pid, signal.SIGCONT)
    assert watcher.stderr.readline() == f"ambientd: {path}: it is back\n"
    assert ended(watcher, signal.SIGINT)[::2] == (0, "")


def test_it_ends_with_1_where_no_one_listens(ambientd, path):
    assert ambientd("watch", path, status=1).stderr == (
        f"ambientd: {path}: no daemon listens there (No such file or directory);"
        f" start one with 'ambientd run ... --publish socket:{path}'\n"
    )


def test_a_reader_of_it_that_has_enough_ends_it(daemon, path):
    daemon()
    done = ran("/bin/sh", "-c", f"{sys.executable} -m ambientd watch {path} | head -n 2")
    assert (len(done.stdout.splitlines()), done.stderr) == (2, "")


def test_what_is_not_known_is_said():
    sensors = {"usb": Sensor("degC", None, 30.0), "current": Sensor("A", -0.25, -0.25)}
    reading = Reading(3723.04, "bench", "faulted", None, None, None, 90, None, sensors)
    assert as_text(reading) == "      3723.0 s  faulted     no estimate  usb missing  current -0.25"
