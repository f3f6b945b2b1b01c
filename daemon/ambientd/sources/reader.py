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
_LOOK_S = 0.05
"""So long after a tick is due all sensors have been read, usually, which puts the alarm off: no clock is read."""

Content = bytes | OSError | None
"""An attribute's content, or its error; None where it did not answer in time."""


class Reader:
    """Reads descriptors in turn, every ``period_s``. ``set_alarm`` takes the s after which to call :meth:`leave`."""

    def __init__(self, set_alarm: Callable[[float], None], period_s: float) -> None:
        self._set_alarm = set_alarm
        self._look_s = period_s + _LOOK_S
        self._turn = 0
        self._current = -1
        """The descriptor that is being read."""
        self._rounds = 0
        self._looked = (0, -1, 0.0)
        """Round and descriptor that were being read when the alarm came, and since when at the latest."""
        self._skipped = {-1}
        """What is not read: nothing, and a descriptor that hung."""

    def begin(self) -> None:
        """Set the alarm for a reading that comes at once; each reading puts it off until after the next."""
        self._set_alarm(_LOOK_S)

    def read(self, descriptors: Sequence[int]) -> list[Content]:
        """The content of each, in their order; None for one that hung, or below 0."""
        turn, skipped, pread = self._turn, self._skipped, os.pread
        contents: list[Content] = []
        self._rounds += 1
        for descriptor in descriptors:
            self._current = descriptor
            try:
                contents.append(None if descriptor in skipped else pread(descriptor, BUFFER_BYTES, 0))
            except OSError as error:
                contents.append(error)
            if turn != self._turn:  # another thread has taken over
                _thread.exit()
        self._current = -1
        self._set_alarm(self._look_s)
        if len(skipped) > 1:
            self._skipped = {-1}
        return contents

    def leave(self) -> bool:
        """Whether the current read hangs: then its thread ends when it returns. Else the alarm is set again."""
        rounds, current, now_s = self._rounds, self._current, time.monotonic()
        if current < 0:
            self._set_alarm(_LOOK_S)
            return False
        if (rounds, current) != self._looked[:2]:
            self._looked = (rounds, current, now_s)
        left_s = self._looked[2] + PATIENCE_S - now_s
        if left_s > 0:
            self._set_alarm(max(left_s, 0.001))
            return False
        self._skipped.add(current)
        self._current = -1
        self._turn += 1
        return True
