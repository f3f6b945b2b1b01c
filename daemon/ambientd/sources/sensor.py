"""An input and the attribute of sysfs that carries it: the descriptor is kept open, and a failure is a missing value.

What the attribute means and where it lies is the business of its :class:`Source`.
"""

import errno
import os
import time
from typing import Protocol

from ambient_model.model import Input
from ambientd.sources.quantities import BUFFER_BYTES
from ambientd.sources.trial import Trial, open_attribute

_PASSING = (errno.EAGAIN, errno.EINTR, errno.ENODATA, errno.EBUSY)
"""The driver has no value now; the same descriptor will have one."""
_PATIENCE_S = 0.25
"""A reading that takes longer is a failure; the clock stands still in a suspend."""


class Source(Protocol):
    """One kind of sensor."""

    unit: str
    """Of what it gives."""
    absent: str
    """What is to be said where it is not found."""

    def find(self) -> list[str]:
        """The paths of the attributes that answer to its name, the one to take first."""

    def value(self, content: bytes) -> float | None:
        """What the bytes of the attribute say, or None where they say nothing."""

    def mend(self) -> str:
        """What to name instead, of what is here."""


class Sensor:
    """One input of the model and the source that carries it."""

    def __init__(self, given: Input, source: Source) -> None:
        self.given = given
        self.name = given.name
        self.source = source
        self.paths: list[str] = []
        """What was found when it was last opened; the first is read."""
        self.trouble = ""
        """Why the last reading gave no value."""
        self._descriptor = -1
        self._slow = False
        self._trial: Trial | None = None

    def open(self) -> None:
        """Look the attribute up and open it, in place of the one it had.

        One that was slow is tried in a thread of its own first, and opened by a later call when it has been quick.
        """
        if self._slow and not self._is_quick():
            return
        self.close()
        self.paths = self.source.find()
        if not self.paths:
            self.trouble = self.source.absent
            return
        try:
            self._descriptor = open_attribute(self.paths[0])
        except OSError as error:
            self.trouble = f"{error.filename}: {error.strerror}"

    def _is_quick(self) -> bool:
        if self._trial is not None:
            if self._trial.took_s is None:
                return False  # it is still at it
            if self._trial.took_s <= _PATIENCE_S:
                self._slow, self._trial = False, None
                return True
        self._trial = Trial(self.paths[0])
        return False

    def read(self) -> float | None:
        """The value in the source's unit, or None where there is none now."""
        if self._descriptor < 0:
            return None
        start_s = time.monotonic()
        try:
            content = os.pread(self._descriptor, BUFFER_BYTES, 0)
        except OSError as error:
            self.trouble = error.strerror or str(error)
            if error.errno not in _PASSING:
                self.close()
            self._note_slow(start_s)
            return None
        if self._note_slow(start_s):
            return None
        value = self.source.value(content)
        if value is None:
            self.trouble = f"it says {content!r}"
        return value

    def _note_slow(self, start_s: float) -> bool:
        took_s = time.monotonic() - start_s
        if took_s > _PATIENCE_S:
            self.close()
            self._slow = True
            self.trouble = f"a reading took {took_s:.1f} s"
        return self._slow

    def close(self) -> None:
        """Let the descriptor go."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
