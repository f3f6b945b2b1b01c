"""A file like a thermal zone's ``temp``: integer millidegrees and a newline, at most 15 bytes, never empty.

A value that is no longer trusted does not stay: the file is removed, or says the poison that was configured. Nor does
one stay that cannot be replaced.
"""

import contextlib
import os

from ambientd.publish import Quiet
from ambientd.publish.spec import MILLIDEGREES_LIMIT
from ambientd.publish.swap import remove, swap_in
from ambientd.report import Report


def _content(report: Report, poison_millidegC: int | None) -> bytes | None:
    """What the file is to hold, or None where it is not to be there."""
    ambient_degC = report.estimate.ambient_degC
    if ambient_degC is not None and abs(ambient_degC) * 1000 < MILLIDEGREES_LIMIT - 1:
        return b"%d\n" % round(ambient_degC * 1000)
    return None if poison_millidegC is None else b"%d\n" % poison_millidegC


class RenamedFile(Quiet):
    """Each value is a new file, renamed over the last: for readers that open it anew each time."""

    def __init__(self, path: str, poison_millidegC: int | None) -> None:
        self._path = path
        self._poison_millidegC = poison_millidegC

    def publish(self, report: Report) -> None:
        """Put the value, the poison or nothing in place; raises OSError."""
        content = _content(report, self._poison_millidegC)
        if content is None:
            return remove(self._path)
        try:
            swap_in(self._path, content)
        except OSError:
            with contextlib.suppress(OSError):
                os.unlink(self._path)
            raise

    def close(self) -> None:
        """Remove the file."""
        remove(self._path)


class InPlaceFile(Quiet):
    """One file, written in place in a single write: for readers that keep it open."""

    def __init__(self, path: str, poison_millidegC: int | None) -> None:
        self._path = path
        self._poison_millidegC = poison_millidegC
        self._descriptor = -1
        self._length = 0

    def publish(self, report: Report) -> None:
        """Write the value or the poison, or remove the file; raises OSError."""
        content = _content(report, self._poison_millidegC)
        if content is None:
            return self._remove()
        try:
            self._write(content)
        except OSError:
            with contextlib.suppress(OSError):
                self._remove()
            raise

    def _write(self, content: bytes) -> None:
        # a file that someone removed or renamed over has no link left: writing on would reach no one
        if self._descriptor >= 0 and os.fstat(self._descriptor).st_nlink == 0:
            self._release()
        if self._descriptor < 0:
            self._open(content)
        os.pwrite(self._descriptor, content, 0)
        if len(content) < self._length:
            os.ftruncate(self._descriptor, len(content))
        self._length = len(content)

    def _open(self, content: bytes) -> None:
        """Keep a file that is there, so that its readers stay; else make one that is never empty."""
        if not os.path.isfile(self._path) or os.path.getsize(self._path) == 0:
            swap_in(self._path, content)
        self._descriptor = os.open(self._path, os.O_RDWR)
        self._length = os.fstat(self._descriptor).st_size

    def _release(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _remove(self) -> None:
        self._release()
        remove(self._path)

    def close(self) -> None:
        """Remove the file; who keeps it open reads the poison from now on, where there is one."""
        if self._descriptor >= 0 and self._poison_millidegC is not None:
            with contextlib.suppress(OSError):
                self._write(b"%d\n" % self._poison_millidegC)
        self._remove()
