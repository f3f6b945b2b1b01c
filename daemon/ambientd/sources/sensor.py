"""An input and the attribute of sysfs that carries it: the descriptor is kept open, and a failure is a missing value.

Its :class:`~ambientd.sources.spec.Location` knows what the attribute means and where it lies.
"""

import errno
import os
from typing import TYPE_CHECKING

from ambient_model.model import Input
from ambientd.sources import reader
from ambientd.sources.reader import Content
from ambientd.sources.trial import Trial, open_attribute

if TYPE_CHECKING:
    from ambientd.settings import Settings
    from ambientd.sources.quantities import Conversion
    from ambientd.sources.spec import Location

_PASSING = (errno.EAGAIN, errno.EINTR, errno.ENODATA, errno.EBUSY)
"""The driver has no value now; the same descriptor will have one."""


class Sensor:
    """One input of the model and where it is read on the device of ``settings``."""

    def __init__(self, given: Input, location: "Location", settings: "Settings") -> None:
        self.given = given
        self.name = given.name
        self._location, self._settings = location, settings
        self._convert: Conversion
        self.paths: list[str] = []
        """What was found when it was last opened; the first is read."""
        self.trouble = ""
        """Why the last reading gave no value."""
        self.descriptor = -1
        """What is to be read; below 0 where there is nothing."""
        self.content: Content = OSError()
        """What was last read that holds a value in its input's range, and that value:"""
        self.value = 0.0
        self._slow = False
        self._trial: Trial | None = None

    def open(self) -> None:
        """Look the attribute up and open it, in place of the one it had.

        One that was slow is tried in a thread of its own first, and opened by a later call when it has been quick.
        """
        if self._slow and not self._is_quick():
            return
        self.close()
        self.paths = self._location.find(self._settings)
        if not self.paths:
            self.trouble = self._location.absent
            return
        self._convert = self._location.conversion(self.paths[0])
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
        """The value in its unit from what was read of ``descriptor``, or None where there is none now."""
        if isinstance(content, bytes):
            value = self._convert(content)
            if value is None:
                self.trouble = f"its content is {content!r}"
            elif self.given.min <= value <= self.given.max:
                self.content, self.value = content, value
            return value
        if self.descriptor < 0:
            return None
        if content is None:
            self.trouble = f"a reading takes more than {reader.PATIENCE_S:g} s"
            self._slow = True
            self.close()
            return None
        self.trouble = content.strerror or str(content)
        if content.errno not in _PASSING:
            self.close()
        return None

    def hint(self) -> str:
        """What to name instead, of what is here."""
        return self._location.hint(self._settings)

    def close(self) -> None:
        """Let the descriptor go."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1
