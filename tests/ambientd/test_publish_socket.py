"""Real sockets: the newest line at once, whole lines only, and no reader delays the daemon."""

import json
import os
import select
import socket
import stat

import pytest

from ambient_model.faults import Refused
from ambient_model.model import Input
from ambient_model.tracking import Estimate
from ambientd.publish.socket import SocketServer
from ambientd.report import Report

INPUTS = tuple(Input(f"s{k}", "degC", "zone", 0, 1) for k in range(10))


def report(time_s):
    estimate = Estimate(20.0, 19.0, 21.0, "tracking", (0.5,) * 10)
    return Report("bench", INPUTS, 90, time_s, (0.5,) * 10, estimate, 0.0)


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "s")


@pytest.fixture
def server(path):
    opened = SocketServer(path)
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
    while True:
        try:
            more = reader.recv(1 << 20)
        except BlockingIOError:
            return content
        if not more:
            return content
        content += more


def times(content):
    return [json.loads(line)["time_s"] for line in content.splitlines()]


def test_who_connects_hears_the_newest_line_at_once_and_then_each(server, path):
    for k in range(3):
        server.publish(report(k))
    with connected(server, path) as reader:
        assert times(received(reader)) == [2]
        server.publish(report(3))
        server.publish(report(4))
        assert times(received(reader)) == [3, 4]


def test_who_connects_before_the_first_tick_waits_for_it(server, path):
    with connected(server, path) as reader:
        assert received(reader) == b""
        server.publish(report(0))
        assert times(received(reader)) == [0]


def test_a_slow_reader_loses_whole_lines_and_the_quick_one_none(server, path):
    with connected(server, path) as slow, connected(server, path) as quick:
        heard = b""
        for k in range(3000):
            server.publish(report(k))
            heard += received(quick)
        assert times(heard) == list(range(3000))
        first = received(slow)
        assert 0 < len(first.splitlines()) < 3000
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


def test_one_reader_too_many_is_let_go(server, path):
    readers = [connected(server, path) for _ in range(33)]
    server.publish(report(1))
    assert [bool(received(reader)) for reader in readers] == [True] * 32 + [False]
    for reader in readers:
        reader.close()


def test_whoever_may_enter_the_folder_may_connect(server, path):
    assert stat.S_IMODE(os.stat(path).st_mode) == 0o666


def test_the_socket_is_removed_at_the_end(path):
    SocketServer(path).close()
    assert not os.path.exists(path)


def test_a_dead_daemons_socket_is_replaced(path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(path)
    server = SocketServer(path)
    connected(server, path).close()
    server.close()


def test_a_live_daemons_socket_is_refused_and_left(server, path):
    with pytest.raises(Refused) as refused:
        SocketServer(path)
    assert str(refused.value) == f"{path}: another daemon listens there; stop it first, or choose another path"
    connected(server, path).close()


def test_what_is_no_socket_is_refused_and_left(path):
    with open(path, "w") as stream:
        stream.write("mine")
    with pytest.raises(Refused) as refused:
        SocketServer(path)
    assert str(refused.value) == f"{path}: exists and is no socket; remove it, or choose another path"
    with open(path) as stream:
        assert stream.read() == "mine"


def test_a_socket_that_another_put_in_its_place_is_left(path):
    server = SocketServer(path)
    os.unlink(path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(path)
        server.close()
        assert os.path.exists(path)


@pytest.mark.parametrize("name", ["missing/s", "x" * 120])
def test_a_path_that_cannot_be_bound_is_refused(tmp_path, name):
    with pytest.raises(Refused, match="cannot be listened on"):
        SocketServer(str(tmp_path / name))
