"""A UNIX stream socket: one JSON object a line a tick, the newest at once on connecting.

A reader never delays the daemon: the rest of a line that its buffer does not take is kept, and the lines until it is
sent are lost to that reader, whole. A user has at most 64 of 256 places. Where no place is left, the user with the most
readers, if it is another than who connects, loses the one of them that has lost the most lines. The last descriptors
are kept for the files, and a flood of connections is served in small portions between which a tick comes first.

A socket that was handed over (:mod:`ambientd.publish.inherited`) is served, and its file is left alone. Any other
is created here: a dead daemon's is replaced, one that vanishes is created anew.
"""

import contextlib
import errno
import os
import socket
import stat
from collections.abc import Mapping

from ambient_model.faults import Refused, refuse
from ambientd.publish.access import grant
from ambientd.publish.inherited import listener_at
from ambientd.publish.spec import Spec
from ambientd.publish.swap import trial
from ambientd.report import Report, as_json

_MOST_READERS = 256
_MOST_OF_A_USER = 64
_AT_ONCE = 32
_KEPT_DESCRIPTORS = 8
"""For the files that are opened and renamed at each tick, and for sensors that come back."""
_BUFFER_BYTES = 8192
"""For each reader; the kernel takes twice of it. With its usual 208 KiB, readers that stop would hold 52 MB of it."""
_NO_MORE = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS)
_LONGEST_PATH_BYTES = 107


def publisher(spec: Spec, patience_ms: int | None) -> "SocketServer":
    """A listening socket."""
    return SocketServer(spec)


def foreseen(spec: Spec) -> str:
    """Mode and owner of the socket that would be made; raises OSError where it could not be."""
    if os.path.lexists(spec.path):
        if stat.S_ISSOCK(os.stat(spec.path).st_mode):
            return "there is a socket already, of a running or a dead daemon, or made by init"
        raise OSError(errno.EEXIST, "it exists and is no socket")
    if len(os.fsencode(spec.path)) > _LONGEST_PATH_BYTES:
        raise OSError(errno.ENAMETOOLONG, f"its path is longer than {_LONGEST_PATH_BYTES} bytes")
    return trial(spec.path, spec.access.for_socket())


class _Reader:
    __slots__ = ("connection", "lost", "rest", "user")

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
        self.user = credentials[4:8]
        """The number of the user who has connected, as the kernel writes it."""
        self.rest = b""
        """The unsent rest of the line begun."""
        self.lost = 0
        """Lines lost since the last one sent."""

    def take(self, line: bytes) -> None:
        """Send what fits of the line begun, and then of ``line``; raises OSError where the reader has left."""
        if self.rest and not self._send():
            self.lost += 1
            return
        self.rest = line
        whole = len(line)
        self._send()
        if len(self.rest) == whole:  # not a byte of it went: it is lost whole
            self.rest = b""
            self.lost += 1
        else:
            self.lost = 0

    def _send(self) -> bool:
        """Send what fits of the rest; True where nothing is left."""
        with contextlib.suppress(BlockingIOError):
            self.rest = self.rest[self.connection.send(self.rest) :]
        return not self.rest


class SocketServer:
    """The listening socket and its readers; what they send is not read.

    Unless its mode is configured, whoever may enter its folder may connect.
    """

    last = False

    def __init__(self, spec: Spec, environment: Mapping[str, str] = os.environ) -> None:
        self._path = spec.path
        self._access = spec.access.for_socket()
        self._granted = True
        self._identity = (0, 0)
        self._newest: Report | None = None
        self._line = b""
        self._readers: dict[bytes, list[_Reader]] = {}
        """By user."""
        self._descriptors = os.sysconf("SC_OPEN_MAX") - _KEPT_DESCRIPTORS
        handed = listener_at(spec.path, environment)
        self._is_ours = handed is None
        self._listener = handed or socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        try:
            self._start()
        except BaseException:
            self._listener.close()
            raise

    def _start(self) -> None:
        try:
            if self._is_ours:
                self._bind()
            else:
                self._listener.listen(_MOST_READERS)
        except OSError as error:
            raise refuse(
                self._path,
                "",
                f"cannot be listened on ({error.strerror or error})",
                "see that the folder exists and is writable, and the path is below 108 bytes",
            ) from error
        with contextlib.suppress(OSError):  # reported at the first tick; nobody can connect until then
            self._grant()

    def _bind(self) -> None:
        """Bind a socket to the path, on the descriptor that is served already; raises OSError or Refused."""
        _clear_stale(self._path)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as fresh:
            fresh.setblocking(False)
            fresh.bind(self._path)
            os.dup2(fresh.fileno(), self._listener.fileno(), inheritable=False)
        found = os.stat(self._path)
        self._identity = (found.st_dev, found.st_ino)
        self._granted = False

    def _grant(self) -> None:
        """Set mode and owner before anyone can connect; raises OSError, and then nobody can."""
        if self._granted:
            return
        try:
            grant(self._path, self._access)
            self._granted = True
        except OSError:
            os.unlink(self._path)
            raise
        finally:
            self._listener.listen(_MOST_READERS)

    def adapt(self, spec: Spec) -> None:
        """Use the access of ``spec`` from the next tick on."""
        self._access = spec.access.for_socket()
        self._granted = not self._is_ours

    def descriptor(self) -> int | None:
        """The listening socket's."""
        return self._listener.fileno()

    def serve(self) -> None:
        """Accept readers that have connected and send them the newest line; disconnect those without a place."""
        for _ in range(_AT_ONCE):
            try:
                connection, _ = self._listener.accept()
            except OSError as error:
                # no one is left; or no descriptor is free, and they wait until one is
                if error.errno in _NO_MORE and self._readers:
                    self._drop_slowest(self._crowd())
                return
            reader = _Reader(connection)
            if not self._has_place(reader):
                connection.close()
                continue
            connection.setblocking(False)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
            self._readers.setdefault(reader.user, []).append(reader)
            if self._newest is not None:
                self._send_newest(reader)

    def _has_place(self, newcomer: _Reader) -> bool:
        """Whether there is room, after it was made at the cost of who has more of it, or reads less."""
        own = self._readers.get(newcomer.user, [])
        count = sum(map(len, self._readers.values()))
        if count >= _MOST_READERS or newcomer.connection.fileno() >= self._descriptors:
            crowd = self._crowd()
            if len(crowd) > len(own) + 1:
                return self._drop_slowest(crowd)
        elif len(own) < _MOST_OF_A_USER:
            return True
        return any(reader.lost for reader in own) and self._drop_slowest(own)

    def _crowd(self) -> list[_Reader]:
        """The readers of the user who has most."""
        return max(self._readers.values(), key=len, default=[])

    def _drop_slowest(self, readers: list[_Reader]) -> bool:
        self._drop(max(readers, key=lambda reader: reader.lost))
        return True

    def publish(self, report: Report) -> None:
        """Send the line to every reader that can take it; raises OSError where no reader can connect."""
        self._newest = report
        self._line = b""
        if self._readers:
            for reader in [reader for readers in self._readers.values() for reader in readers]:
                self._send_newest(reader)
        if self._is_ours:
            self._stay()

    def _send_newest(self, reader: _Reader) -> None:
        if not self._line and self._newest is not None:
            self._line = f"{as_json(self._newest)}\n".encode()
        try:
            reader.take(self._line)
        except OSError:
            self._drop(reader)

    def _drop(self, reader: _Reader) -> None:
        readers = self._readers[reader.user]
        readers.remove(reader)
        if not readers:
            del self._readers[reader.user]
        reader.connection.close()

    def _stay(self) -> None:
        """Restore the socket where it was removed from its folder."""
        if not self._in_place():
            try:
                self._bind()
            except Refused as refused:
                raise OSError(errno.EADDRINUSE, refused.faults[0].problem, self._path) from refused
        if not self._granted:
            self._grant()

    def _in_place(self) -> bool:
        try:
            found = os.stat(self._path)
        except OSError:
            return False
        return (found.st_dev, found.st_ino) == self._identity

    def close(self) -> None:
        """Disconnect the readers and remove the socket, unless it is another's or was replaced."""
        for readers in self._readers.values():
            for reader in readers:
                reader.connection.close()
        self._readers = {}
        self._listener.close()
        if self._in_place():
            os.unlink(self._path)


def _clear_stale(path: str) -> None:
    """Remove the socket that a dead daemon left at ``path``; refuse a live one's, and what is no socket."""
    try:
        mode = os.lstat(path).st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise refuse(path, "", "exists and is no socket", "remove it, or choose another path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        if probe.connect_ex(path) != errno.ECONNREFUSED:
            raise refuse(path, "", "another daemon listens there", "stop it first, or choose another path")
    os.unlink(path)
