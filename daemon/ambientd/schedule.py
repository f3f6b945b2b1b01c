"""Deadlines are absolute, on a clock that also counts suspend; missed ones are skipped; a signal ends it all."""

import math
import os
import select
import signal
import time
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType

_CLOCK: int = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def clock_s() -> float:
    """Seconds since boot, suspend included where the system can tell."""
    return time.clock_gettime(_CLOCK)


class Waiter:
    """Waits for deadlines and serves what comes in meanwhile; SIGTERM and SIGINT end the wait for good.

    A context: inside it the two signals are its own.
    """

    def __init__(self) -> None:
        self.ended = False
        self._served: dict[int, Callable[[], None]] = {}

    def serve(self, descriptor: int, call: Callable[[], None]) -> None:
        """Call ``call`` whenever ``descriptor`` is readable while a deadline is waited for."""
        self._served[descriptor] = call

    def until(self, due_s: float) -> bool:
        """Wait for ``due_s`` on :func:`clock_s`; False where a signal ended it. What is ready is always served."""
        while not self.ended:
            for descriptor in select.select(list(self._served), [], [], max(0.0, due_s - clock_s()))[0]:
                self._served[descriptor]()
            if clock_s() >= due_s:
                break
        return not self.ended

    def __enter__(self) -> "Waiter":
        # without the pipe, a signal between the check and the wait would be noticed one tick late
        self._wake, self._awaken = os.pipe()
        os.set_blocking(self._wake, False)
        os.set_blocking(self._awaken, False)
        self._before_fd = signal.set_wakeup_fd(self._awaken)
        self._before = {each: signal.signal(each, self._end) for each in (signal.SIGTERM, signal.SIGINT)}
        self.serve(self._wake, lambda: None)
        return self

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.ended = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._before_fd)
        os.close(self._wake)
        os.close(self._awaken)


def ticks(period_s: float, until: Callable[[float], bool], clock: Callable[[], float] = clock_s) -> Iterator[float]:
    """The time at each deadline, the first at once, until ``until`` says that it is over."""
    due_s = clock()
    while until(due_s):
        now_s = clock()
        yield now_s
        due_s = next_deadline(due_s, clock(), period_s)


def next_deadline(due_s: float, now_s: float, period_s: float) -> float:
    """The first deadline after ``now_s`` on the grid of ``due_s``."""
    return due_s + period_s * max(1, math.floor((now_s - due_s) / period_s) + 1)
