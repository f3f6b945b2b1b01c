"""A UNIX stream socket: one JSON object a line a tick, the newest at once on connecting.

A reader never delays the daemon: what its buffer does not take is kept to the end of that line, and the lines that
come until then are lost to it, whole. Where all places are taken, the reader that has lost the most makes room.

A socket that was handed over (:mod:`ambientd.publish.inherited`) is served, and its file left to who made it. Any
other is made here: one that a dead daemon left is replaced, one that vanishes is made anew.
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
from ambientd.report import Report, as_json

_MOST_READERS = 256
_BUFFER_BYTES = 8192
"""For each reader; the kernel takes twice of it. With its usual 208 KiB, readers that stop would hold 52 MB of it."""
_NO_MORE = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS)


class _Reader:
    __slots__ = ("connection", "lost", "rest")

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.rest = b""
        """What is left of the line that it has begun to take."""
        self.lost = 0
        """How many lines since it last took one."""

    def take(self, line: bytes) -> None:
        """Send what goes of what was begun, and then of ``line``; raises OSError where the reader has left."""
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
        """Send what goes of the rest; True where nothing is left over."""
        with contextlib.suppress(BlockingIOError):
            self.rest = self.rest[self.connection.send(self.rest) :]
        return not self.rest


class SocketServer:
    """The listening socket and its readers; what they send is not read.

    Whoever may enter its folder may connect, where its mode is not configured.
    """

    def __init__(self, spec: Spec, environment: Mapping[str, str] = os.environ) -> None:
        self._path = spec.path
        self._access = spec.access.for_socket()
        self._granted = True
        self._identity = (0, 0)
        self._newest: Report | None = None
        self._line = b""
        self._readers: list[_Reader] = []
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
        with contextlib.suppress(OSError):  # said at the first tick, when no one could enter so far
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
        """Let in those who may enter, and nobody before that is settled; raises OSError, and then nobody may."""
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
        """Let in whom ``spec`` names, from the next tick on."""
        self._access = spec.access.for_socket()
        self._granted = not self._is_ours

    def descriptor(self) -> int | None:
        """The listening socket's."""
        return self._listener.fileno()

    def serve(self) -> None:
        """Take in a reader and tell it the newest line; where there is no room for it, it is let go again."""
        try:
            connection, _ = self._listener.accept()
        except OSError as error:
            # it left before it was taken in; or no descriptor is free, and it waits until one is
            if error.errno in _NO_MORE and self._readers:
                self._drop(self._slowest())
            return
        if len(self._readers) == _MOST_READERS:
            slowest = self._slowest()
            if not slowest.lost:
                return connection.close()
            self._drop(slowest)
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        reader = _Reader(connection)
        self._readers.append(reader)
        if self._newest is not None:
            self._tell(reader)

    def _slowest(self) -> _Reader:
        return max(self._readers, key=lambda reader: reader.lost)

    def publish(self, report: Report) -> None:
        """Send the line to every reader that can take it; raises OSError where no more can come."""
        self._newest = report
        self._line = b""
        for reader in list(self._readers):
            self._tell(reader)
        if self._is_ours:
            self._stay()

    def _tell(self, reader: _Reader) -> None:
        if not self._line and self._newest is not None:
            self._line = f"{as_json(self._newest)}\n".encode()
        try:
            reader.take(self._line)
        except OSError:
            self._drop(reader)

    def _drop(self, reader: _Reader) -> None:
        self._readers.remove(reader)
        reader.connection.close()

    def _stay(self) -> None:
        """See that readers can come: a socket whose folder was removed is reached by no one."""
        if not self._in_place():
            try:
                self._bind()
            except Refused as refused:
                raise OSError(errno.EADDRINUSE, refused.faults[0].problem, self._path) from refused
        self._grant()

    def _in_place(self) -> bool:
        try:
            found = os.stat(self._path)
        except OSError:
            return False
        return (found.st_dev, found.st_ino) == self._identity

    def close(self) -> None:
        """Let the readers go and remove the socket, unless it is another's or another has taken its place."""
        for reader in self._readers:
            reader.connection.close()
        self._readers = []
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
