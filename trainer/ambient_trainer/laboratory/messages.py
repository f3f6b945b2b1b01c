"""What the threads of a run tell its conductor, with the run's own time; nothing else passes between them.

The run's time is that of its clock, less where the run began: see :class:`Timebase`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ambient_trainer.laboratory.clock import Clock

CHAMBER, MULTIPLEXER, THERMOMETER, DEVICE = "chamber", "multiplexer", "thermometer", "device"


class Sample(NamedTuple):
    """One instrument's reading, by column; None where it had nothing to say."""

    source: str
    asked_s: float
    answered_s: float
    values: Mapping[str, float | None]
    note: str | None = None
    """What else it said: the chamber's alarm, or that the device was started anew."""

    @property
    def at_s(self) -> float:
        """The time that it is of: the middle of asking and answering."""
        return 0.5 * (self.asked_s + self.answered_s)


class Trouble(NamedTuple):
    """Something did not work; it is tried again."""

    source: str
    at_s: float
    text: str


class Doing(NamedTuple):
    """The actions that the device is known to do from now on, or None: not known."""

    at_s: float
    actions: tuple[str, ...] | None


class Crash(NamedTuple):
    """A thread ended by an error of the program itself."""

    source: str
    error: BaseException


Message = Sample | Trouble | Doing | Crash
Post = Callable[[Message], None]


class Timebase(NamedTuple):
    """One time for all of a run's instruments, also over a stop and a new start."""

    clock: Clock
    zero_s: float
    """What the clock said when the run's time was 0."""

    def now_s(self) -> float:
        """The run's time."""
        return self.clock.now_s() - self.zero_s

    def of(self, clock_s: float) -> float:
        """The run's time when the clock said ``clock_s``."""
        return clock_s - self.zero_s
