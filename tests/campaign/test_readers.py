"""A crowd on the socket: who reads gets every line, who does not read delays no one."""

import contextlib
import json
import socket

import pytest

READERS = 200


@pytest.fixture
def connected():
    """Connect to a socket; what is still open at the end of the test is closed."""
    opened = []

    def connect(path):
        opened.append(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        opened[-1].connect(str(path))
        opened[-1].setblocking(False)
        return opened[-1]

    yield connect
    for each in opened:
        each.close()


def taken(reader):
    """What it has not taken so far."""
    content = b""
    with contextlib.suppress(BlockingIOError):
        while part := reader.recv(65536):
            content += part
    return content


def test_two_hundred_readers_of_which_half_never_read(start, connected):
    """Who reads misses no line. Who reads in the end finds whole lines, some lost: that is what not reading costs."""
    daemon = start()
    descriptors = daemon.descriptors
    readers = []
    for _ in range(READERS):
        readers.append(connected(daemon.outputs.socket))
        daemon.step(0.0)
    quick, idle = readers[::2], readers[1::2]
    said = dict.fromkeys(quick, b"")
    expected = [daemon.step()["time_s"] for _ in range(3)]
    for _ in range(120):
        expected.append(daemon.step()["time_s"])
        for reader in quick:
            said[reader] += taken(reader)
    for content in said.values():
        times_s = [json.loads(line)["time_s"] for line in content.splitlines()]
        assert times_s[-len(expected) :] == expected
    for reader in idle:
        *lines, rest = taken(reader).split(b"\n")
        times_s = [json.loads(line)["time_s"] for line in lines]
        assert times_s == sorted(set(times_s))
        assert 0 < len(times_s) < len(expected)
        assert rest == b"" or rest.startswith(b"{")
    for reader in readers:
        reader.close()
    daemon.steps(2)
    assert daemon.descriptors == descriptors
    assert daemon.end() == []
