"""Sockets that init or systemd made: real processes that inherit a descriptor, as those hand it over."""

import json
import os
import socket

import pytest

from ambient_model.faults import Refused
from ambientd.publish.inherited import handed_over, listener_at
from ambientd.publish.socket import SocketServer
from ambientd.publish.spec import Spec

AS_SYSTEMD = (
    "import os, sys; os.dup2(int(sys.argv[1]), 3); os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS='1');"
    "os.execv(sys.executable, [sys.executable, '-m', 'ambientd', *sys.argv[2:]])"
)


@pytest.fixture
def made(path):
    """A socket as init makes it: bound, with a mode of its own, and not listening."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(path)
        os.chmod(path, 0o640)
        yield listener


@pytest.fixture
def daemon(start, made, on_phone):
    """Start a daemon that inherits the socket, as from Android's init or from systemd."""

    def begin(manager, *outputs):
        descriptor = made.fileno()
        how = {"by": ("-c", AS_SYSTEMD, str(descriptor))}
        if manager == "init":
            how = {"env": {**os.environ, "ANDROID_SOCKET_ambientd": str(descriptor)}}
        return start(*on_phone(*outputs), pass_fds=[descriptor], **how)

    return begin


@pytest.mark.parametrize("manager", ["init", "systemd"])
def test_a_socket_that_was_handed_over_is_served_and_left(daemon, until, ended, listen, made, path, tmp_path, manager):
    if manager == "systemd":
        made.listen()
    process = daemon(manager, f"socket:{path}", f"status:{tmp_path}/status")
    inode = os.stat(path).st_ino
    until((tmp_path / "status").exists)
    for _ in range(2):
        lines = listen(path)
        for _ in range(2):
            assert json.loads(lines.readline())["ambient_degC"] == pytest.approx(23.0)
    status, _, log = ended(process)
    assert (status, len(log.splitlines())) == (0, 1)
    found = os.stat(path)
    assert (found.st_ino, found.st_mode & 0o777) == (inode, 0o640)  # whose it is, is for who made it to say


def test_one_that_no_publication_names_is_told_of(daemon, until, ended, path, tmp_path):
    process = daemon("init", f"status:{tmp_path}/status")
    until((tmp_path / "status").exists)
    _, _, log = ended(process)
    assert log.startswith(f"ambientd: {path}: was handed over and is not served")


def test_the_path_says_which_is_meant(made, path, tmp_path):
    environment = {"ANDROID_SOCKET_ambientd": str(made.fileno())}
    assert handed_over(environment) == {path: made.fileno()}
    assert listener_at(f"{tmp_path}/other", environment) is None
    with listener_at(f"{tmp_path}/./s", environment) as listener:
        assert listener.getsockname() == path
        assert listener.fileno() != made.fileno()  # a copy: a publication may go and come back
    for _ in range(2):
        server = SocketServer(Spec("socket", path), environment)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reader:
            reader.connect(path)
        server.close()
        assert os.path.exists(path)


@pytest.mark.parametrize(
    "environment",
    [
        *({"ANDROID_SOCKET_ambientd": number} for number in ("999", "-1", "x", "9" * 30, "0")),
        {"LISTEN_FDS": "1024", "LISTEN_PID": "1"},
        {"LISTEN_FDS": "1024"},
        {"LISTEN_FDS": "", "LISTEN_PID": str(os.getpid())},
        {},
    ],
)
def test_what_is_no_socket_or_meant_for_another_process_is_left_alone(environment, made):
    assert handed_over(environment) == {}


def test_a_datagram_socket_is_refused(path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as made:
        made.bind(path)
        with pytest.raises(Refused, match="no stream socket"):
            SocketServer(Spec("socket", path), {"ANDROID_SOCKET_ambientd": str(made.fileno())})
