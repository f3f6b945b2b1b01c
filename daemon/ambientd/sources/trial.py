"""A reading in a thread of its own: finds out whether an attribute answers in time again, without waiting for it."""

import _thread
import contextlib
import os
import time


def open_attribute(path: str) -> int:
    """A descriptor to read the attribute with; raises OSError. A pipe in its place does not block."""
    return os.open(path, os.O_RDONLY | os.O_NONBLOCK)


class Trial:
    """Opens and reads the attribute at ``path`` once. A read that never returns delays neither reader nor exit."""

    def __init__(self, path: str) -> None:
        self.took_s: float | None = None
        """How long it took, value or error; None while it reads."""
        self._path = path
        # without a thread to spare it never finishes, and the attribute stays set aside
        with contextlib.suppress(RuntimeError):
            _thread.start_new_thread(self._read, ())

    def _read(self) -> None:
        start_s = time.monotonic()
        with contextlib.suppress(OSError):
            descriptor = open_attribute(self._path)
            try:
                os.pread(descriptor, 1, 0)
            finally:
                os.close(descriptor)
        self.took_s = time.monotonic() - start_s
