"""A file like :mod:`ambientd.publish.file`, written in place in a single write: for readers that keep it open."""

import os

from ambientd.publish.access import grant
from ambientd.publish.claims import open_own
from ambientd.publish.file import KEYS, RenamedFile, configured, overwrite, poison
from ambientd.publish.spec import Spec
from ambientd.publish.swap import put

__all__ = ["KEYS", "InPlaceFile", "configured", "publisher"]


def publisher(spec: Spec, patience_ms: int | None) -> "InPlaceFile":
    """A file that is written in place."""
    return InPlaceFile(spec)


class InPlaceFile(RenamedFile):
    """One file, written in place."""

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec)
        self._descriptor = -1
        self._identity = (0, 0)
        self._length = 0
        self._granted = True

    def adapt(self, spec: Spec) -> None:
        """Use ``spec`` from the next value on."""
        self._spec = spec
        self._granted = False

    def _put(self, value: bytes) -> None:
        if self._descriptor >= 0 and not self._in_place():
            self._write_poison()
            self._release()
        if self._descriptor < 0 and self._open(value):
            return
        if not self._granted:
            grant(self._descriptor, self._spec.access)
            self._granted = True
        overwrite(self._descriptor, value, self._length)
        self._length = len(value)

    def _in_place(self) -> bool:
        """Whether the open file is still the one at the path: a write into another would reach no reader."""
        try:
            found = os.lstat(self._spec.path)
        except FileNotFoundError:
            return False
        return (found.st_dev, found.st_ino) == self._identity

    def _open(self, value: bytes) -> bool:
        """Keep a file that is there, so that its readers stay; else make one that is never empty. True where made."""
        path, access = self._spec.path, self._spec.access
        try:
            self._descriptor = open_own(path, access.owner)
            kept = os.fstat(self._descriptor).st_size > 0
        except OSError:
            kept = False
        self._granted = not kept
        if not kept:
            self._release()
            self._descriptor = put(path, value, access)
        found = os.fstat(self._descriptor)
        self._identity = (found.st_dev, found.st_ino)
        self._length = found.st_size
        return not kept

    def _write_poison(self) -> None:
        """Replace the last value by the poison, if any, for readers that keep the file open."""
        instead = poison(self._spec)
        if self._descriptor >= 0 and instead is not None:
            try:
                overwrite(self._descriptor, instead, self._length)
                self._length = len(instead)
            except OSError:
                pass

    def _release(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _remove(self) -> None:
        self._release()
        super()._remove()

    _withdraw = _remove

    def close(self) -> None:
        """Leave the poison in the file, or remove it; a reader that keeps it open reads the poison, if any."""
        self._write_poison()
        self.publish(None)
        self._release()
