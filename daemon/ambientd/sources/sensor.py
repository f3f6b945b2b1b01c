"""An input and the attribute of sysfs that carries it: the descriptor is kept open, and a failure is a missing value.

Its :class:`Source` knows what the attribute means and where it lies.
"""

import errno
import os
from typing import Protocol

from ambient_model.model import Input
from ambientd.sources import reader
from ambientd.sources.reader import Content
from ambientd.sources.trial import Trial, open_attribute

_PASSING = (errno.EAGAIN, errno.EINTR, errno.ENODATA, errno.EBUSY)
"""The driver has no value now; the same descriptor will have one."""


class Source(Protocol):
    """One kind of sensor."""

    unit: str
    """The unit of its values."""
    absent: str
    """The message where it is not found."""

    def find(self) -> list[str]:
        """The paths of the attributes with its name, the one to read first."""

    def value(self, content: bytes) -> float | None:
        """The value in the bytes of the attribute, or None."""

    def hint(self) -> str:
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
        self.descriptor = -1
        """What is to be read; below 0 where there is nothing."""
        self._content: Content = None
        """What was last read that holds a value."""
        self._value = 0.0
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
            self.descriptor = open_attribute(self.paths[0])
        except OSError as error:
            self.trouble = f"{error.filename}: {error.strerror}"

    def _is_quick(self) -> bool:
        if self._trial is not None:
            if self._trial.took_s is None:
                return False  # it is still reading
            if self._trial.took_s <= reader.PATIENCE_S:
                self._slow, self._trial = False, None
                return True
        self._trial = Trial(self.paths[0])
        return False

    def take(self, content: Content) -> float | None:
        """The value in the source's unit from what was read of ``descriptor``, or None where there is none now."""
        if content is not None and content == self._content:
            return self._value
        if self.descriptor < 0:
            return None
        if content is None:
            self.trouble = f"a reading takes more than {reader.PATIENCE_S:g} s"
            self._slow = True
            self.close()
            return None
        if isinstance(content, OSError):
            self.trouble = content.strerror or str(content)
            if content.errno not in _PASSING:
                self.close()
            return None
        value = self.source.value(content)
        if value is None:
            self.trouble = f"its content is {content!r}"
        else:
            self._content, self._value = content, value
        return value

    def close(self) -> None:
        """Let the descriptor go."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1
