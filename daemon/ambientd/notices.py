"""Messages to the log: a fault is reported once, and once when it is over; one that flaps does not flood the log.

A log that is full, gone or not read loses messages and delays nothing.
"""

import os
import select

_STDERR = 2
_MOST = 6
_WITHIN_S = 600.0


def log(message: str) -> None:
    """Write ``message`` to standard error, if there is room."""
    room = select.poll()
    room.register(_STDERR, select.POLLOUT)
    try:
        if room.poll(0):
            os.write(_STDERR, f"ambientd: {message}\n".encode(errors="backslashreplace"))
    except OSError:
        pass


class Notice:
    """Whether a change is reported: at most 6 in ten minutes are."""

    def __init__(self) -> None:
        self.wrong = False
        """What was last reported."""
        self._reported_s: list[float] = []

    def changed(self, now_s: float, wrong: bool) -> bool:
        """True where ``wrong`` is not what was last reported, and is to be reported now."""
        if wrong == self.wrong:
            return False
        if len(self._reported_s) == _MOST and now_s - self._reported_s[0] < _WITHIN_S:
            return False
        self.wrong = wrong
        self._reported_s = [*self._reported_s, now_s][-_MOST:]
        return True
