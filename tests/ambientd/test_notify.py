"""The service manager's side is a real datagram socket, at a path or with an abstract name."""

import contextlib
import os
import signal
import socket
import subprocess
import time
import uuid

import pytest

from ambientd.notify import Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """A listening socket and the name of it for NOTIFY_SOCKET."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.settimeout(10)
    name = str(tmp_path / "notify") if request.param == "path" else f"@ambientd-test-{uuid.uuid4()}"
    listener.bind(name.replace("@", "\0"))
    yield listener, name
    listener.close()


def heard(listener):
    return listener.recv(4096).decode().split("\n")


def waiting(listener):
    """All that was told and not yet heard."""
    listener.setblocking(False)
    told = []
    with contextlib.suppress(BlockingIOError):
        while True:
            told.append(listener.recv(4096))
    return told


@pytest.mark.parametrize(
    "environment",
    [{}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": "1"}],
)
def test_without_a_watchdog_of_its_own_no_tick_is_told(manager, environment):
    listener, name = manager
    notifier = Notifier({"NOTIFY_SOCKET": name, **environment}, pytest.fail)
    notifier.ticked(0.0)
    notifier.expect(100.0)
    assert notifier.watchdog_s is None
    assert waiting(listener) == []
    notifier.close()


def test_what_a_full_socket_does_not_take_is_owed_with_its_newest_value(manager):
    (listener, name), notes = manager, []
    notifier = Notifier({"NOTIFY_SOCKET": name}, notes.append)
    for k in range(5000):
        notifier.status(str(k))
    assert notes == [f"{name}: the service manager cannot be notified (Resource temporarily unavailable)"]
    notifier.ready("4999")
    assert waiting(listener)[0] == b"STATUS=0"
    notifier.ticked(0.0)
    assert listener.recv(100) == b"STATUS=4999\nREADY=1"
    notifier.close()


@pytest.mark.parametrize(
    ("address", "note"),
    [
        ("{}/n", "{}/n: the service manager cannot be notified (No such file or directory)"),
        ("vsock:2:1", "NOTIFY_SOCKET is 'vsock:2:1', no path and no abstract name: the manager is not notified"),
    ],
)
def test_a_manager_that_cannot_be_told_is_noted_once(tmp_path, address, note):
    notes = []
    notifier = Notifier({"NOTIFY_SOCKET": address.format(tmp_path)}, notes.append)
    notifier.ready("up")
    notifier.stopping()
    notifier.close()
    assert notes == [note.format(tmp_path)]


def test_a_watchdog_too_short_for_the_ticks_is_noted(tmp_path):
    notes = []
    notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "n"), "WATCHDOG_USEC": "5000000"}, notes.append)
    for ticks_s in (2.0, 10.0):
        notifier.expect(ticks_s)
    assert notes == ["the watchdog of 5 s is too short for ticks 10 s apart; set WatchdogSec= to 20 s or more"]
    notifier.close()


def test_the_daemon_is_ready_when_it_has_published_and_pings_while_it_ticks(manager, start, on_phone, tmp_path):
    listener, name = manager
    environment = {**os.environ, "NOTIFY_SOCKET": name, "WATCHDOG_USEC": "400000"}
    daemon = start(*on_phone(f"file:{tmp_path}/temp"), env=environment, stdout=subprocess.DEVNULL)
    assert heard(listener) == ["READY=1", "STATUS=model 'bench': warming_up"]
    assert (tmp_path / "temp").read_text() == "23000\n"
    assert [heard(listener) for _ in range(5)] == [["WATCHDOG=1"]] * 5
    daemon.send_signal(signal.SIGSTOP)  # what does not tick does not ping
    time.sleep(0.2)
    waiting(listener)
    time.sleep(0.5)
    assert waiting(listener) == []
    daemon.send_signal(signal.SIGCONT)
    listener.settimeout(10)
    assert heard(listener) == ["WATCHDOG=1"]
    daemon.terminate()
    said = [heard(listener)]
    while said[-1] == ["WATCHDOG=1"]:
        said.append(heard(listener))
    assert said[-1] == ["STOPPING=1", "STATUS=stopping"]
    assert daemon.wait(10) == 0
