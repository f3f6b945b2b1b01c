"""Real sockets: the newest line at once, whole lines only, and no reader delays the daemon."""

import contextlib
import json
import os
import select
import socket
import stat
import subprocess
import sys
from unittest.mock import Mock

import pytest

from ambient_model.model import Input
from ambient_model.tracking import Estimate
from ambientd.publish.access import Access
from ambientd.publish.socket import SocketServer
from ambientd.publish.spec import Spec
from ambientd.report import Report
from refusals import refused

INPUTS = tuple(Input(f"s{k}", "degC", "zone", 0, 1) for k in range(10))


def report(time_s):
    estimate = Estimate(20.0, 19.0, 21.0, "tracking", (0.5,) * 10)
    return Report("bench", INPUTS, 90, time_s, (0.5,) * 10, estimate, 0.0)


@pytest.fixture
def server(path):
    opened = SocketServer(Spec("socket", path))
    yield opened
    opened.close()


def connected(server, path):
    reader = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    reader.connect(path)
    reader.settimeout(10)
    assert select.select([server.descriptor()], [], [], 10)[0]
    server.serve()
    return reader


def received(reader):
    reader.setblocking(False)
    content = b""
    with contextlib.suppress(BlockingIOError):
        while more := reader.recv(1 << 20):
            content += more
    return content


def times(content):
    return [json.loads(line)["time_s"] for line in content.splitlines()]


def test_a_slow_reader_loses_whole_lines_and_the_quick_one_none(server, path):
    with connected(server, path) as slow, connected(server, path) as quick:
        heard = b""
        for k in range(3000):
            server.publish(report(k))
            heard += received(quick)
        assert times(heard) == list(range(3000))
        first = received(slow)
        assert 0 < len(first.splitlines()) < 3000
        assert len(first) <= 16384, "a reader that stops takes little of the kernel memory"
        server.publish(report(3000))
        server.publish(report(3001))
        every = times(first + received(slow))
        assert every == sorted(set(every))
        assert every[-1] == 3001


def test_a_reader_that_leaves_is_let_go(server, path):
    before = len(os.listdir("/proc/self/fd"))
    for k in range(5):
        connected(server, path).close()
        server.publish(report(k))
        server.publish(report(k))
    assert len(os.listdir("/proc/self/fd")) == before


def test_where_a_users_places_are_taken_who_reads_least_makes_room(server, path):
    """A consumer that leaks its connections does not shut itself out."""
    readers = [connected(server, path) for _ in range(64)]
    with connected(server, path) as refused:
        assert refused.recv(1) == b""  # all others read what they get
    for k in range(100):
        server.publish(report(k))
        for reader in readers[1:]:
            received(reader)
    with connected(server, path) as late:
        assert times(received(late)) == [99]
    said = received(readers[0])
    assert times(said[: said.rindex(b"\n")])[-1] < 99
    assert readers[0].recv(1) == b""  # it was let go
    for reader in readers:
        reader.close()


HOLD = """
import os, socket, sys
os.setuid(65534)
held = [socket.socket(socket.AF_UNIX) for _ in range(300)]
for each in held:
    each.connect(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root becomes another user")
@pytest.mark.parametrize("limit", [1024, 32])
def test_another_user_takes_neither_the_places_nor_the_descriptors(limit, public, on_phone, spawn, listen, until):
    """``nobody`` holds what it gets; the next five find a place at once, and the file is still renewed."""
    path, file = f"{public}/s", f"{public}/temp"
    run = [sys.executable, "-m", "ambientd", *on_phone(f"file:{file}", f"socket:{path}")]
    spawn(["sh", "-c", f'ulimit -n {limit}; exec "$@"', "sh", *run], stdout=None)
    until(lambda: os.path.exists(file))
    crowd = spawn([sys.executable, "-I", "-S", "-c", HOLD, path], stdin=subprocess.PIPE)
    assert crowd.stdout.readline() == "held\n"
    for _ in range(5):
        assert len(times(listen(path).readline())) == 1
    before = os.stat(file).st_ino, os.stat(file).st_mtime_ns
    until(lambda: (os.stat(file).st_ino, os.stat(file).st_mtime_ns) != before)


def test_a_path_that_another_has_taken_is_its_own_and_told_of(server, path):
    with connected(server, path) as early:
        os.unlink(path)
        with socket.create_server(path, family=socket.AF_UNIX):
            with pytest.raises(OSError, match="another daemon listens there"):
                server.publish(report(1))
            assert times(received(early)) == [1]
        server.publish(report(2))  # it is dead now
        connected(server, path).close()


def test_no_one_enters_before_it_is_settled_who_may(path, monkeypatch):
    monkeypatch.setattr(os, "chown", Mock(side_effect=PermissionError(1, "Operation not permitted")))
    server = SocketServer(Spec("socket", path, access=Access(0o600, owner=4711)))
    for k in range(2):
        assert not os.path.exists(path)
        with pytest.raises(PermissionError):
            server.publish(report(k))
    assert select.select([server.descriptor()], [], [], 0)[0] == []  # nothing that would keep the daemon busy
    server.adapt(Spec("socket", path, access=Access(0o600)))
    server.publish(report(2))
    assert stat.S_IMODE(os.stat(path).st_mode) == 0o600
    with connected(server, path) as reader:
        assert times(received(reader)) == [2]
    server.close()


def test_a_socket_that_another_put_in_its_place_is_left(path):
    server = SocketServer(Spec("socket", path))
    os.unlink(path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(path)
        server.close()
        assert os.path.exists(path)


def test_a_path_where_another_daemon_listens_is_refused_and_left(server, path):
    assert "another daemon listens there" in str(refused(SocketServer, Spec("socket", path)))
    connected(server, path).close()
