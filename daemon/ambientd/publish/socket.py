"""A UNIX stream socket: one JSON object a line a tick, the newest at once on connecting.

A reader never delays the daemon: what its buffer does not take is kept to the end of that line, and the lines that
come until then are lost to it, whole.
"""

import contextlib
import errno
import os
import socket
import stat

from ambient_model.faults import refuse
from ambientd.report import Report, as_json

_MOST_READERS = 32


class SocketServer:
    """The listening socket and its readers. Whoever may enter its folder may connect; what they send is not read."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._newest = b""
        self._readers: dict[socket.socket, bytes] = {}
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        try:
            self._bind()
        except BaseException:
            self._listener.close()
            raise

    def _bind(self) -> None:
        try:
            _clear_stale(self._path)
            self._listener.bind(self._path)
            self._inode = os.stat(self._path).st_ino
            os.chmod(self._path, 0o666)
            self._listener.listen(_MOST_READERS)
        except OSError as error:
            raise refuse(
                self._path,
                "",
                f"cannot be listened on ({error.strerror or error})",
                "see that the folder exists and is writable, and the path is below 108 bytes",
            ) from error

    def descriptor(self) -> int | None:
        """The listening socket's."""
        return self._listener.fileno()

    def serve(self) -> None:
        """Take in a reader and tell it the newest line; one too many is let go again."""
        try:
            reader, _ = self._listener.accept()
        except OSError:  # it left before it was taken in
            return
        if len(self._readers) == _MOST_READERS:
            reader.close()
            return
        reader.setblocking(False)
        self._readers[reader] = b""
        self._send(reader, self._newest)

    def publish(self, report: Report) -> None:
        """Send the line to every reader that can take it."""
        self._newest = f"{as_json(report)}\n".encode()
        for reader in list(self._readers):
            rest = self._readers[reader]
            if not rest or self._send(reader, rest):
                self._send(reader, self._newest)

    def _send(self, reader: socket.socket, content: bytes) -> bool:
        """Send what goes; True where nothing is left over and the reader is still there."""
        try:
            sent = reader.send(content) if content else 0
        except (BlockingIOError, InterruptedError):
            sent = 0
            if not self._readers[reader]:  # not a byte of this line went: it is lost whole
                return False
        except OSError:
            del self._readers[reader]
            reader.close()
            return False
        self._readers[reader] = content[sent:]
        return sent == len(content)

    def close(self) -> None:
        """Let the readers go and remove the socket, unless another has taken its place."""
        for reader in self._readers:
            reader.close()
        self._readers = {}
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            if os.stat(self._path).st_ino == self._inode:
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
