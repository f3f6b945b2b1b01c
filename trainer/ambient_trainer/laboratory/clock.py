"""One monotonic time for a run: the machine's own, or one that runs faster. Whoever waits or stamps asks a clock."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Seconds that never jump; where they start means nothing."""

    def now_s(self) -> float:
        """The time."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Return ``duration_s`` of this clock later, at once where it is not positive."""
        ...

    def wait(self, event: threading.Event, duration_s: float) -> bool:
        """Whether ``event`` is set, at the latest ``duration_s`` of this clock from now."""
        ...

    def wall_s(self, duration_s: float) -> float:
        """How many of the machine's seconds ``duration_s`` of this clock are."""
        ...

    def patience_s(self, duration_s: float) -> float:
        """How many of the machine's seconds to give to a thing that takes at most ``duration_s`` of this clock."""
        ...


class RealClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        """The time."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Return ``duration_s`` later."""
        time.sleep(max(duration_s, 0.0))

    def wait(self, event: threading.Event, duration_s: float) -> bool:
        """Whether ``event`` is set within ``duration_s``."""
        return event.wait(max(duration_s, 0.0))

    def wall_s(self, duration_s: float) -> float:
        """``duration_s`` itself."""
        return duration_s

    def patience_s(self, duration_s: float) -> float:
        """``duration_s`` itself."""
        return duration_s


class FastClock:
    """A clock that runs ``speed`` times as fast as the machine's, from ``start_s`` on."""

    LEAST_PATIENCE_S = 0.5
    """However fast the clock, a loaded machine may need this long to let the other side answer."""

    def __init__(self, speed: float, start_s: float = 0.0) -> None:
        if not speed > 0.0:
            raise ValueError(f"a clock's speed is positive, not {speed}")
        self.speed = speed
        self._start_s = start_s
        self._began_s = time.monotonic()

    def now_s(self) -> float:
        """The time."""
        return self._start_s + (time.monotonic() - self._began_s) * self.speed

    def sleep(self, duration_s: float) -> None:
        """Return ``duration_s`` of this clock later."""
        time.sleep(max(duration_s, 0.0) / self.speed)

    def wait(self, event: threading.Event, duration_s: float) -> bool:
        """Whether ``event`` is set within ``duration_s`` of this clock."""
        return event.wait(max(duration_s, 0.0) / self.speed)

    def wall_s(self, duration_s: float) -> float:
        """``duration_s`` of this clock in the machine's seconds."""
        return duration_s / self.speed

    def patience_s(self, duration_s: float) -> float:
        """``duration_s`` of this clock in the machine's seconds, but never too few for a machine to answer in."""
        return max(duration_s / self.speed, self.LEAST_PATIENCE_S)
