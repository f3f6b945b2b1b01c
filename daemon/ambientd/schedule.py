"""Deadlines are absolute, on a clock that also counts suspend; missed ones are skipped; a signal ends it all."""

import _signal as signal  # type: ignore[import-not-found]  # whose public name takes enum and functools along
import _thread
import math
import os
import select
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from ambient_model.faults import refuse
from ambientd.notices import log

if TYPE_CHECKING:
    from types import FrameType, TracebackType

SIGHUP: int = signal.SIGHUP
_CLOCK: int = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
_NONE: tuple[int, ...] = ()
_GRACE_S = 0.5
"""How long a reading or a writing that blocks may keep a daemon that is to end."""


def clock_s(clock: Callable[[int], float] = time.clock_gettime) -> float:
    """Seconds since boot, suspend included where the system counts it."""
    return clock(_CLOCK)


class _Overdue(BaseException):
    """Something blocks, and the daemon is to end."""


class Waiter:
    """Waits for deadlines and serves what comes in meanwhile; SIGTERM and SIGINT end the wait for good.

    The signals in ``pausing`` end it until :meth:`paused` is asked. A context: inside it the signals are its own, and
    what still blocks half a second after one has ended the wait is abandoned, and with it the context.
    """

    def __init__(self, pausing: Sequence[int] = ()) -> None:
        self.ended = False
        self._paused = False
        self._pausing = pausing
        self._served: dict[int, Callable[[], None]] = {}
        self._watched: list[int] = []
        self._hangs: Callable[[], None] | None = None

    def carry_out(self, work: Callable[[], None], leave: Callable[[], bool]) -> None:
        """Call ``work`` in a thread until it returns; raises what it raises.

        This thread only takes signals, so that one is handled while ``work`` hangs. When the alarm comes and ``leave``
        says that it hangs, ``work`` is called again in another thread, and the one that hangs has to end itself.
        """
        # a signal ends the read of this pipe, also one that comes before it; a lock would miss that one
        here, there = os.pipe()
        os.set_blocking(there, False)
        before = signal.set_wakeup_fd(there)
        over: list[BaseException | None] = []

        def end(error: BaseException | None) -> None:
            if not over:
                over.append(error)
                os.write(there, b"\0")

        def attempt() -> None:
            try:
                work()
            except SystemExit:  # it was left
                return
            except BaseException as error:
                return end(error)
            end(None)

        def apart() -> None:
            signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # they have to wake the first thread
            attempt()

        def hangs() -> None:
            if leave():
                try:
                    _thread.start_new_thread(apart, ())
                except RuntimeError:
                    hint = "allow more (TasksMax=), or leave out that sensor"
                    end(refuse("sensors", "", "a reading hangs, and no thread is to spare", hint))

        self._hangs = hangs
        try:
            try:
                _thread.start_new_thread(apart, ())
            except RuntimeError:  # none to spare: it has to do without
                attempt()
            while not over:
                os.read(here, 4096)
        finally:
            over.append(None)  # a thread that hangs has nobody to report to
            self._hangs = None
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.set_wakeup_fd(before)
            os.close(here)
            os.close(there)
        if over[0] is not None:
            raise over[0]

    def set_alarm(self, after_s: float) -> None:
        """Look ``after_s`` from now whether the work hangs; 0 is never."""
        if not self.ended:
            signal.setitimer(signal.ITIMER_REAL, after_s)

    def serve(self, descriptor: int, call: Callable[[], None]) -> None:
        """Call ``call`` whenever ``descriptor`` is readable while a deadline is waited for."""
        self._served[descriptor] = call
        self._watched = list(self._served)

    def forget(self, descriptor: int) -> None:
        """Serve ``descriptor`` no longer."""
        del self._served[descriptor]
        self._watched = list(self._served)

    def until(self, due_s: float, start_s: float) -> float | None:
        """Wait from ``start_s`` to ``due_s`` on :func:`clock_s`, or until that goes back; the time, None by a signal.

        What is ready is always served.
        """
        clock = time.clock_gettime
        now_s = start_s
        while not (self.ended or self._paused):
            ready = select.select(self._watched, _NONE, _NONE, due_s - now_s if due_s > now_s else 0.0)[0]
            for descriptor in ready:
                self._served[descriptor]()
            now_s = clock(_CLOCK)
            if not start_s <= now_s < due_s and not (self.ended or self._paused):
                return now_s
        if self.ended:  # nothing blocks: what follows is the end itself, and may take its time
            signal.setitimer(signal.ITIMER_REAL, 0)
        return None

    def paused(self) -> bool:
        """Whether a pausing signal came since this was last asked."""
        paused, self._paused = self._paused, False
        return paused

    def __enter__(self) -> "Waiter":
        # without the pipe, a signal between the check and the wait would be noticed one tick late
        self._wake, self._awaken = os.pipe()
        os.set_blocking(self._wake, False)
        os.set_blocking(self._awaken, False)
        self._before_fd = signal.set_wakeup_fd(self._awaken)
        handlers = {signal.SIGTERM: self._end, signal.SIGINT: self._end, signal.SIGALRM: self._leave}
        handlers.update(dict.fromkeys(self._pausing, self._pause))
        self._before = {each: signal.signal(each, handler) for each, handler in handlers.items()}
        self.serve(self._wake, self._drain)
        return self

    def _drain(self) -> None:
        try:
            os.read(self._wake, 4096)
        except BlockingIOError:
            pass

    def _end(self, number: int, frame: "FrameType | None") -> None:
        self.ended = True
        signal.setitimer(signal.ITIMER_REAL, _GRACE_S)
        self._rouse()

    def _pause(self, number: int, frame: "FrameType | None") -> None:
        self._paused = True
        self._rouse()

    def _rouse(self) -> None:
        """End the wait of the thread that ticks, which the signal's own byte may have ended too early."""
        try:
            os.write(self._awaken, b"\0")
        except BlockingIOError:
            pass

    def _leave(self, number: int, frame: "FrameType | None") -> None:
        if self.ended:
            raise _Overdue
        if self._hangs is not None:
            self._hangs()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: "TracebackType | None"
    ) -> bool:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._before_fd)
        os.close(self._wake)
        os.close(self._awaken)
        if kind is not _Overdue:
            return False
        log("something blocked at the end and was abandoned")
        return True


class Ticks:
    """The time at each deadline, the first at once, until ``until`` gives none; counts the deadlines that were missed.

    A suspend costs none, as the monotonic clock does not count it. Where the clock goes back, the grid begins anew.
    A tick that ends before the next is due, which is the usual one, needs neither that clock nor the grid.
    """

    def __init__(
        self, period_s: float, until: Callable[[float, float], float | None], clock: Callable[[], float] = clock_s
    ) -> None:
        self._period_s = period_s
        self._until = until
        self._clock = clock
        self.missed = 0
        self.back_s = 0.0
        """How far the clock has gone back at the last tick."""
        self.steps_back = 0

    def __iter__(self) -> Iterator[float]:
        clock, until, period_s = self._clock, self._until, self._period_s
        due_s = last_s = start_s = clock()
        asleep_s = last_s - time.monotonic()
        while (now_s := until(due_s, start_s)) is not None:
            if now_s < last_s:
                self.back_s = last_s - now_s
                self.steps_back += 1
                due_s = now_s
            elif self.back_s:
                self.back_s = 0.0
            last_s = now_s
            yield now_s
            start_s = now_s = clock()
            if due_s <= now_s < due_s + period_s:
                due_s += period_s
                continue
            next_s = next_deadline(due_s, now_s, period_s)
            before_s, asleep_s = asleep_s, now_s - time.monotonic()
            late_s = now_s - due_s - max(0.0, asleep_s - before_s)
            self.missed += min(round((next_s - due_s) / period_s) - 1, max(0, int(late_s / period_s)))
            due_s = min(next_s, now_s + period_s)


def next_deadline(due_s: float, now_s: float, period_s: float) -> float:
    """The first deadline after ``now_s`` on the grid of ``due_s``."""
    return due_s + period_s * max(1, math.floor((now_s - due_s) / period_s) + 1)
