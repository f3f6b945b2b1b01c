"""One monotonic time for a run: the machine's own, or ``speed`` times as fast. Whoever waits or stamps asks a clock."""

from __future__ import annotations

import threading
import time


class Clock:
    """Seconds since the clock was made, which pass ``speed`` times as fast as the machine's."""

    LEAST_PATIENCE_S = 0.5
    """However fast the clock, a loaded machine may need this long to let the other side answer."""

    def __init__(self, speed: float = 1.0) -> None:
        if not speed > 0.0:
            raise ValueError(f"a clock's speed is positive, not {speed}")
        self.speed = speed
        self._began_s = time.monotonic()

    def now_s(self) -> float:
        """The time, which never jumps."""
        return (time.monotonic() - self._began_s) * self.speed

    def sleep(self, duration_s: float) -> None:
        """Return ``duration_s`` of this clock later, at once where it is not positive."""
        time.sleep(self.wall_s(max(duration_s, 0.0)))

    def wait(self, event: threading.Event, duration_s: float) -> bool:
        """Whether ``event`` is set within ``duration_s`` of this clock."""
        return event.wait(self.wall_s(max(duration_s, 0.0)))

    def wall_s(self, duration_s: float) -> float:
        """``duration_s`` of this clock in the machine's seconds."""
        return duration_s / self.speed

    def patience_s(self, duration_s: float) -> float:
        """The machine's seconds to wait for what takes at most ``duration_s``, enough for a machine to answer in."""
        return max(self.wall_s(duration_s), min(duration_s, self.LEAST_PATIENCE_S))
