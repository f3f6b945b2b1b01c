"""The lines of the socket on standard output. A full pipe loses lines, and does not delay the daemon."""

import os
import select

from ambientd.publish import Quiet
from ambientd.publish.spec import Spec
from ambientd.report import Report, as_json

_STDOUT = 1


TAKES_PATH = False


def publisher(spec: Spec, patience_ms: int | None) -> "Stdout":
    """Lines on standard output."""
    return Stdout(patience_ms)


class Stdout(Quiet):
    """Standard output; ``patience_ms`` is how long a full pipe is waited for, None for ever."""

    def __init__(self, patience_ms: int | None) -> None:
        self._patience_ms = patience_ms
        self._room = select.poll()
        self._room.register(_STDOUT, select.POLLOUT)

    def publish(self, report: Report) -> None:
        """Write the line; raises OSError."""
        # a pipe that polls writable takes a whole line of up to 4 KiB without blocking
        if self._room.poll(self._patience_ms):
            os.write(_STDOUT, f"{as_json(report)}\n".encode())

    def adapt(self, spec: Spec) -> None:
        """Nothing of it is configurable."""

    def close(self) -> None:
        """Nothing stays behind."""
