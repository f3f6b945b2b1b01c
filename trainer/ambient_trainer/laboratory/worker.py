"""Each instrument is asked in its own thread on its own absolute schedule: a slow one delays no other, nor catches up.

A query that was due while the last one was still out is left out.
"""

from __future__ import annotations

import math
import threading

from ambient_trainer.laboratory.instruments import Driver
from ambient_trainer.laboratory.messages import Crash, Failure, Post, Timebase
from ambient_trainer.laboratory.reading import InstrumentError


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
        """Do what is due; returns the run's time of the next turn."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of what the thread holds; called in it at the end."""

    def finish(self) -> None:
        """Ask the thread to end; it may be in an exchange, so join it with patience."""
        self.finished = True
        self.woken.set()

    def failed(self, error: InstrumentError, again_after_s: float) -> float:
        """Post ``error``; returns the run's time of the next attempt."""
        now_s = self.timebase.now_s()
        self.post(Failure(self.source, now_s, str(error)))
        return now_s + again_after_s

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
            self.close()


class Sampler(Worker):
    """Takes a sample at every multiple of ``period_s``, the first one in its second turn."""

    def __init__(self, source: str, instrument: Driver, period_s: float, timebase: Timebase, post: Post) -> None:
        super().__init__(source, timebase, post)
        self._instrument = instrument
        self._period_s = period_s
        self._scheduled = False

    def turn(self) -> float:
        """Read the instrument, and post the sample."""
        try:
            if self._scheduled:
                self.post(self.timebase.sample(self.source, self._instrument.read()))
        except InstrumentError as error:
            self.failed(error, 0.0)
        self._scheduled = True
        return next_multiple(self.timebase.now_s(), self._period_s)

    def close(self) -> None:
        """Close the instrument."""
        self._instrument.close()


def next_multiple(now_s: float, period_s: float) -> float:
    """The first multiple of ``period_s`` after ``now_s``."""
    return (math.floor(now_s / period_s) + 1) * period_s
