"""What instruments answer, and what happens in a run: what its threads post, and what its journal keeps.

Whoever waits or stamps asks the run's one clock, as fast as the machine's time or ``speed`` times as fast. All times
are its seconds, which go on over a stop and a new start. An error names instrument, port, what was expected and what
came.
"""

import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, NamedTuple, TypeVar

_Result = TypeVar("_Result")
_UPTIME = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # a suspended machine's chamber goes on


class Clock:
    """Seconds since the clock was made or set, which pass ``speed`` times as fast as the machine's."""

    LEAST_PATIENCE_S = 0.5
    """However fast the clock, a loaded machine may need this long to let the other side answer."""

    def __init__(self, speed: float = 1.0) -> None:
        if not speed > 0.0:
            raise ValueError(f"a clock's speed is positive, not {speed}")
        self.speed = speed
        self.set(0.0)

    def set(self, now_s: float) -> None:
        """Let it be ``now_s`` now; a run's clock is set when the run begins or goes on, and not while it lasts."""
        self._zero_s = time.clock_gettime(_UPTIME) - now_s / self.speed

    def now_s(self) -> float:
        """The time, which goes on evenly whatever the machine's calendar does, and while the machine is suspended."""
        return (time.clock_gettime(_UPTIME) - self._zero_s) * self.speed

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


def in_background(question: Callable[..., _Result], *arguments: object) -> Future[_Result]:
    """What ``question`` comes to, asked in a thread of its own; one that is never answered holds nothing up."""
    answer: Future[_Result] = Future()

    def ask() -> None:
        try:
            answer.set_result(question(*arguments))
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=ask, name=question.__name__, daemon=True).start()
    return answer


CHAMBER, MULTIPLEXER, THERMOMETER, DEVICE = "chamber", "multiplexer", "thermometer", "device"
CHAMBER_SET_POINT, CHAMBER_GRADIENT = "the chamber's set point", "the chamber's gradient"
"""Sources of a :class:`Failure` to do what the campaign asks for: the run is not complete with one."""
CLOCK_OFFSET = "device_clock_offset_s"
"""Column of the device: its uptime less the time here."""


class Reading(NamedTuple):
    """One answer: values by column (None for none), and when it was asked for and came.

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
    """One instrument's reading in a run."""

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


class Recovered(NamedTuple):
    """What a :class:`Failure` of the same source reported is over."""

    source: str
    at_s: float


class LoadState(NamedTuple):
    """The actions of the device from now on; None where they are not known."""

    at_s: float
    actions: tuple[str, ...] | None


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


Message = Sample | Failure | Recovered | LoadState
Post = Callable[[Message], None]
Entry = Sample | Failure | LoadState | StepBegan | Note | Identity | End
ENTRIES: dict[str, type[Any]] = {
    **{"sample": Sample, "trouble": Failure, "doing": LoadState, "began": StepBegan},
    **{"note": Note, "identity": Identity, "end": End},
}
"""By its name in a journal the kind of an entry."""
