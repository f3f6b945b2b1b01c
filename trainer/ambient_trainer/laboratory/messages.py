"""What happens in a run, each with the run's own time: what its threads post, and what its journal keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.reading import Reading

CHAMBER, MULTIPLEXER, THERMOMETER, DEVICE = "chamber", "multiplexer", "thermometer", "device"
CLOCK_OFFSET = "device_clock_offset_s"
"""Column of the device: its uptime less the time here."""


class Sample(NamedTuple):
    """One instrument's reading, in the run's time."""

    source: str
    asked_s: float
    answered_s: float
    values: Mapping[str, float | None]
    note: str | None = None

    @property
    def at_s(self) -> float:
        """The time of the sample: the middle of asking and answering."""
        return 0.5 * (self.asked_s + self.answered_s)


class Failure(NamedTuple):
    """An instrument did not do what it was asked for; it is tried again."""

    source: str
    at_s: float
    text: str


class LoadState(NamedTuple):
    """The actions of the device from now on; None where they are not known."""

    at_s: float
    actions: tuple[str, ...] | None


class Crash(NamedTuple):
    """A thread ended by an error of the program itself."""

    source: str
    error: BaseException


class StepBegan(NamedTuple):
    """The program is in a step from now on, ``elapsed_s`` into it."""

    at_s: float
    step: int
    elapsed_s: float


class Note(NamedTuple):
    """An event for the summary."""

    at_s: float
    text: str


class Identity(NamedTuple):
    """An instrument's own identification."""

    source: str
    text: str


class End(NamedTuple):
    """The program was left at ``at_s``; what comes after it saw to safety, or is a resumption."""

    at_s: float
    why: str


Message = Sample | Failure | LoadState | Crash
Entry = Message | StepBegan | Note | Identity | End
Post = Callable[[Message], None]


class Timebase(NamedTuple):
    """One time for all of a run's instruments, also over a stop and a new start; ``zero_s`` is the clock's at its 0."""

    clock: Clock
    zero_s: float

    def now_s(self) -> float:
        """The run's time."""
        return self.clock.now_s() - self.zero_s

    def sample(self, source: str, reading: Reading) -> Sample:
        """``reading`` in the run's time, in which the device's clock offset counts, too."""
        values = dict(reading.values)
        if (offset_s := values.get(CLOCK_OFFSET)) is not None:
            values[CLOCK_OFFSET] = round(offset_s + self.zero_s, 4)
        return Sample(source, reading.asked_s - self.zero_s, reading.answered_s - self.zero_s, values, reading.note)
