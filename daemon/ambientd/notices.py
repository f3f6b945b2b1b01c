"""What goes wrong is said once, and once when it is well again; what flaps does not flood the log.

A log that is full, gone or not read loses words, and holds up nothing.
"""

import contextlib
import os
import select

_STDERR = 2
_MOST = 6
_WITHIN_S = 600.0


def say(message: str) -> None:
    """Say ``message`` on standard error, where the journal finds it, if there is room."""
    room = select.poll()
    room.register(_STDERR, select.POLLOUT)
    with contextlib.suppress(OSError):
        if room.poll(0):
            os.write(_STDERR, f"ambientd: {message}\n".encode(errors="backslashreplace"))


class Notice:
    """Whether a change for the worse or the better is worth a word: at most 6 in ten minutes are."""

    def __init__(self) -> None:
        self._wrong = False
        self._told_s: list[float] = []

    def changed(self, now_s: float, wrong: bool) -> bool:
        """True where ``wrong`` is not what was last told, and it should be told now."""
        if wrong == self._wrong:
            return False
        if len(self._told_s) == _MOST and now_s - self._told_s[0] < _WITHIN_S:
            return False
        self._wrong = wrong
        self._told_s = [*self._told_s, now_s][-_MOST:]
        return True
