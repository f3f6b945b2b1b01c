"""Sensors are read in a thread of their own: a read that hangs is abandoned with its thread and delays no tick.

A driver may sleep uninterruptibly, where no signal ends the read.
"""

import _thread
import contextlib
import os
import time
from collections.abc import Sequence

from ambientd.sources.quantities import BUFFER_BYTES

PATIENCE_S = 0.25
"""A reading that takes longer is a failure; the clock stands still in a suspend."""

Content = bytes | OSError | None
"""An attribute's content, or its error; None where it did not answer in time."""


class Reader:
    """Reads descriptors, one after the other."""

    def __init__(self) -> None:
        self._thread: _Thread | None = None

    def read(self, descriptors: Sequence[int]) -> list[Content]:
        """The content of each, in their order; None for one below 0."""
        contents: list[Content] = []
        while len(contents) < len(descriptors):
            if self._thread is None:
                self._thread = _Thread()
            found, hangs = self._thread.read(descriptors[len(contents) :])
            contents += found
            if hangs:
                self._thread.leave()
                self._thread = None
                if len(contents) < len(descriptors):
                    contents.append(None)
        return contents

    def close(self) -> None:
        """End the thread."""
        if self._thread is not None:
            self._thread.leave()
            self._thread = None


class _Thread:
    """One thread that reads when it is asked to, until it is left."""

    def __init__(self) -> None:
        self._descriptors: Sequence[int] = ()
        self._contents: list[Content] = []
        self._since_s = 0.0
        """When the current read began."""
        self._left = False
        self._asked = _thread.allocate_lock()
        self._answered = _thread.allocate_lock()
        self._asked.acquire()
        self._answered.acquire()
        try:
            _thread.start_new_thread(self._serve, ())
            self._alone = False
        except RuntimeError:  # none to spare: the caller reads
            self._alone = True

    def read(self, descriptors: Sequence[int]) -> tuple[list[Content], bool]:
        """The contents of the first of them, and whether the next one hangs: then the thread is to be left."""
        self._descriptors, self._contents = descriptors, []
        if self._alone:
            self._read()
            return self._contents, False
        self._since_s = time.monotonic()
        self._asked.release()
        wait_s = PATIENCE_S
        while not self._answered.acquire(True, wait_s):
            wait_s = self._since_s + PATIENCE_S - time.monotonic()
            if wait_s <= 0:
                return self._contents[:], True
        return self._contents, False

    def leave(self) -> None:
        """Let it end, at once or when what it reads has returned."""
        self._left = True
        if not self._alone:
            with contextlib.suppress(RuntimeError):  # it has not begun
                self._asked.release()

    def _serve(self) -> None:
        while self._asked.acquire() and not self._left:
            self._read()
            self._answered.release()

    def _read(self) -> None:
        contents = self._contents
        for descriptor in self._descriptors:
            if self._left:  # the rest belongs to another thread
                return
            self._since_s = time.monotonic()
            try:
                contents.append(os.pread(descriptor, BUFFER_BYTES, 0) if descriptor >= 0 else None)
            except OSError as error:
                contents.append(error)
