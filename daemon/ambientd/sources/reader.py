"""Sensors are read in the thread that ticks; where a read hangs, it is left behind with that thread.

A driver may sleep uninterruptibly, where no signal ends the read. The alarm then calls :meth:`Reader.leave`, and
another thread does the tick again without the sensor: see :meth:`ambientd.schedule.Waiter.carry_out`.
"""

import _thread
import os
import time
from collections.abc import Callable, Sequence

from ambientd.sources.quantities import BUFFER_BYTES

PATIENCE_S = 0.25
"""A reading that takes longer is a failure; the clock stands still in a suspend."""

Content = bytes | OSError | None
"""An attribute's content, or its error; None where it did not answer in time."""


class Reader:
    """Reads descriptors in turn. ``set_alarm`` takes the s after which to call :meth:`leave`; 0 is never."""

    def __init__(self, set_alarm: Callable[[float], None]) -> None:
        self._set_alarm = set_alarm
        self._turn = 0
        self._current = -1
        """The descriptor that is being read, since:"""
        self._since_s = 0.0
        self._hung: set[int] = set()

    def read(self, descriptors: Sequence[int]) -> list[Content]:
        """The content of each, in their order; None for one that hung, or below 0."""
        turn, hung, clock = self._turn, self._hung, time.monotonic
        contents: list[Content] = []
        self._since_s = clock()
        self._set_alarm(PATIENCE_S)
        for descriptor in descriptors:
            if descriptor < 0 or descriptor in hung:
                contents.append(None)
                continue
            self._since_s, self._current = clock(), descriptor
            try:
                content: Content = os.pread(descriptor, BUFFER_BYTES, 0)
            except OSError as error:
                content = error
            if turn != self._turn:  # another thread has taken over
                _thread.exit()
            contents.append(content)
        self._current = -1
        self._set_alarm(0)
        hung.clear()
        return contents

    def leave(self) -> bool:
        """Whether the current read hangs: then its thread ends when it returns. Else the alarm is set again."""
        left_s = self._since_s + PATIENCE_S - time.monotonic()
        if self._current < 0 or left_s > 0:
            self._set_alarm(max(left_s, 0.001) if self._current >= 0 else 0)
            return False
        self._hung.add(self._current)
        self._current = -1
        self._turn += 1
        return True
