"""A reading in a thread of its own: whether an attribute answers in time, without waiting for one that hangs."""

import _thread
import os
import time
from collections.abc import Sequence

from ambientd.sources.quantities import BUFFER_BYTES

_LOOK_S = 0.001


def open_attribute(path: str) -> int:
    """A descriptor to read the attribute with; raises OSError. A pipe in its place does not block."""
    return os.open(path, os.O_RDONLY | os.O_NONBLOCK)


class Trial:
    """Opens and reads the attribute at ``path`` once. A read that never returns delays neither reader nor exit."""

    def __init__(self, path: str) -> None:
        self.took_s: float | None = None
        """How long it took, value or error; None while it reads."""
        self.content: bytes | OSError | None = None
        """What was read."""
        self._path = path
        # without a thread to spare it never finishes, and the attribute stays set aside
        try:
            _thread.start_new_thread(self._read, ())
        except RuntimeError:
            pass

    def _read(self) -> None:
        start_s = time.monotonic()
        try:
            descriptor = open_attribute(self._path)
            try:
                self.content = os.pread(descriptor, BUFFER_BYTES, 0)
            finally:
                os.close(descriptor)
        except OSError as error:
            self.content = error
        self.took_s = time.monotonic() - start_s


def finished(trials: Sequence[Trial], within_s: float) -> None:
    """Wait until all ``trials`` are, for at most ``within_s``."""
    end_s = time.monotonic() + within_s
    while time.monotonic() < end_s and any([each.took_s is None for each in trials]):
        time.sleep(_LOOK_S)
