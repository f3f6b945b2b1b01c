"""A file like a thermal zone's ``temp``: integer millidegrees and a newline, at most 15 bytes, never empty.

A value that is no longer trusted does not stay: the file is removed, or says the poison that was configured. Nor does
one stay that cannot be replaced, or whose daemon ends.
"""

import contextlib
import os

from ambientd.publish import Quiet
from ambientd.publish.access import grant
from ambientd.publish.spec import MILLIDEGREES_LIMIT, Spec
from ambientd.publish.swap import put, remove, swap_in, sweep
from ambientd.report import Report


def _content(report: Report, spec: Spec) -> bytes | None:
    """What the file is to hold, or None where it is not to be there."""
    ambient_degC = report.estimate.ambient_degC
    if ambient_degC is not None and abs(ambient_degC) * 1000 < MILLIDEGREES_LIMIT - 1:
        return b"%d\n" % (round(ambient_degC * 1000) + spec.offset_millidegC)
    return _poison(spec)


def _poison(spec: Spec) -> bytes | None:
    return None if spec.poison_millidegC is None else b"%d\n" % spec.poison_millidegC


def _overwrite(descriptor: int, content: bytes, length: int) -> None:
    """Put ``content`` in place of what is ``length`` bytes long; raises OSError.

    In one write: what is left of a longer content is made newlines by it, and only then cut off. A shorter content is
    given the length first: who reads meanwhile would take the digits of the new as far as the old one went.
    """
    if len(content) > length:
        os.pwrite(descriptor, b"\n" * (len(content) - length), length)
    os.pwrite(descriptor, content.ljust(length, b"\n"), 0)
    if len(content) < length:
        os.ftruncate(descriptor, len(content))


class RenamedFile(Quiet):
    """Each value is a new file, renamed over the last: for readers that open it anew each time."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        sweep(spec.path)

    def adapt(self, spec: Spec) -> None:
        """Let ``spec`` hold from the next value on."""
        self._spec = spec

    def publish(self, report: Report) -> None:
        """Put the value, the poison or nothing in place; raises OSError."""
        self._become(_content(report, self._spec))

    def _become(self, content: bytes | None) -> None:
        if content is None:
            return remove(self._spec.path)
        try:
            swap_in(self._spec.path, content, self._spec.access)
        except OSError:
            with contextlib.suppress(OSError):
                self._withdraw()
            raise

    def _withdraw(self) -> None:
        """Let the value that is there not stay. A full disk has room for the poison in its place."""
        poison = _poison(self._spec)
        if poison is not None:
            with contextlib.suppress(OSError):
                descriptor = os.open(self._spec.path, os.O_WRONLY | os.O_CLOEXEC)
                try:
                    return _overwrite(descriptor, poison, os.fstat(descriptor).st_size)
                finally:
                    os.close(descriptor)
        os.unlink(self._spec.path)

    def close(self) -> None:
        """Remove the file, or leave the poison in it; raises OSError."""
        self._become(_poison(self._spec) if self._spec.at_exit == "poison" else None)


class InPlaceFile(Quiet):
    """One file, written in place in a single write: for readers that keep it open."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._descriptor = -1
        self._identity = (0, 0)
        self._length = 0
        sweep(spec.path)

    def adapt(self, spec: Spec) -> None:
        """Let ``spec`` hold from the next value on."""
        self._spec = spec
        self._release()

    def publish(self, report: Report) -> None:
        """Write the value or the poison, or remove the file; raises OSError."""
        self._become(_content(report, self._spec))

    def _become(self, content: bytes | None) -> None:
        if content is None:
            return self._remove()
        try:
            self._write(content)
        except OSError:
            with contextlib.suppress(OSError):
                self._remove()
            raise

    def _write(self, content: bytes) -> None:
        if self._descriptor >= 0 and not self._in_place():
            self._say_poison()
            self._release()
        if self._descriptor < 0 and self._open(content):
            return
        _overwrite(self._descriptor, content, self._length)
        self._length = len(content)

    def _in_place(self) -> bool:
        """Whether the open file is still the one at the path: to write on into another would reach no one."""
        try:
            found = os.stat(self._spec.path)
        except FileNotFoundError:
            return False
        return (found.st_dev, found.st_ino) == self._identity

    def _open(self, content: bytes) -> bool:
        """Keep a file that is there, so that its readers stay; else make one that is never empty. True where made."""
        path, access = self._spec.path, self._spec.access
        kept = os.path.isfile(path) and os.path.getsize(path) > 0
        self._descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC) if kept else put(path, content, access)
        if kept:
            grant(self._descriptor, access)
        found = os.fstat(self._descriptor)
        self._identity = (found.st_dev, found.st_ino)
        self._length = found.st_size
        return not kept

    def _say_poison(self) -> None:
        """Let who keeps the file open not be left with its last value, where there is a poison."""
        poison = _poison(self._spec)
        if self._descriptor >= 0 and poison is not None:
            with contextlib.suppress(OSError):
                _overwrite(self._descriptor, poison, self._length)
                self._length = len(poison)

    def _release(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _remove(self) -> None:
        self._release()
        remove(self._spec.path)

    def close(self) -> None:
        """Leave the poison in the file, or remove it; who keeps that open reads the poison, where there is one."""
        self._say_poison()
        if self._spec.at_exit != "poison":
            return self._remove()
        self._become(_poison(self._spec))
        self._release()
