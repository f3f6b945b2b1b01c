"""What instruments answer, and what happens in a run: what its threads post, and what its journal keeps.

Whoever waits or stamps asks a clock: the machine's time, or ``speed`` times as fast. A reading has the clock's times, a
message or an entry the run's own. An error names instrument, port, what was expected and what came.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple


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


CHAMBER, MULTIPLEXER, THERMOMETER, DEVICE = "chamber", "multiplexer", "thermometer", "device"
CLOCK_OFFSET = "device_clock_offset_s"
"""Column of the device: its uptime less the time here."""


class Reading(NamedTuple):
    """One answer: values by column (None for none), and when, in the clock's seconds.

    The note is what else the instrument reports, such as an alarm, or why it has no value.
    """

    asked_s: float
    answered_s: float
    values: Mapping[str, float | None]
    note: str | None = None


class InstrumentError(Exception):
    """An exchange with an instrument that failed; the next one may succeed."""

    hint = "is it the instrument that belongs on this port, and does no other program use it?"

    def __init__(self, instrument: str, port: str, expected: str, got: str, hint: str | None = None) -> None:
        self.instrument, self.port, self.expected, self.got = instrument, port, expected, got
        self.hint = hint or self.hint
        super().__init__(instrument, port, expected, got)

    def __str__(self) -> str:
        return f"{self.instrument} on {self.port}: expected {self.expected}, got {self.got}; {self.hint}"


class Disconnected(InstrumentError):
    """The port is not there, is in use by another, or went while it was in use."""

    hint = "plug it in, or correct the port; it is opened again by itself"


class NoResponse(InstrumentError):
    """Nothing came in time."""

    hint = "is it switched on, and is this its port and its speed?"


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
