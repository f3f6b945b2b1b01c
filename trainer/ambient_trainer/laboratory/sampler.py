"""Each instrument is asked in its own thread on its own absolute schedule: a slow one delays no other, nor catches up.

A question that was due while the last one was still out is left out.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.messages import Crash, Post, Sample, Timebase, Trouble


class Worker(threading.Thread):
    """A thread of a run: ``turn`` is called again and again until ``finish``; what it raises is posted as a crash."""

    def __init__(self, source: str, timebase: Timebase, post: Post) -> None:
        super().__init__(name=source, daemon=True)
        self.source = source
        self.timebase = timebase
        self.post = post
        self.woken = threading.Event()
        self.finished = False

    def turn(self) -> float:
        """Do what is to be done now; returns the run's time of the next turn."""
        raise NotImplementedError

    def leave(self) -> None:
        """Let go of what the thread holds; called in it at the end."""

    def finish(self) -> None:
        """Ask the thread to end; it may be in an exchange, so join it with patience."""
        self.finished = True
        self.woken.set()

    def run(self) -> None:
        """The thread's life."""
        try:
            while not self.finished:
                due_s = self.turn()
                while not self.finished and (left_s := due_s - self.timebase.now_s()) > 0.0:
                    if self.timebase.clock.wait(self.woken, left_s):
                        break
                if not self.finished:
                    self.woken.clear()
        except BaseException as error:
            self.post(Crash(self.source, error))
        finally:
            self.leave()


class Sampler(Worker):
    """Takes a sample at every multiple of ``period_s``."""

    def __init__(
        self,
        source: str,
        timebase: Timebase,
        post: Post,
        period_s: float,
        take: Callable[[], Sample],
        close: Callable[[], None],
    ) -> None:
        super().__init__(source, timebase, post)
        self._period_s = period_s
        self._take = take
        self._close = close
        self._first = True

    def turn(self) -> float:
        """Ask once, but in the very first turn, which only finds the schedule."""
        if self._first:
            self._first = False
        else:
            try:
                self.post(self._take())
            except LineError as error:
                self.post(Trouble(self.source, self.timebase.now_s(), str(error)))
        return following(self.timebase.now_s(), self._period_s)

    def leave(self) -> None:
        """Close the instrument."""
        self._close()


def following(now_s: float, period_s: float) -> float:
    """The first multiple of ``period_s`` after ``now_s``."""
    return (math.floor(now_s / period_s) + 1) * period_s
