"""For consumers: read the published file or status, follow the socket, and detect when it is stale.

This file needs the standard library alone and may be copied. What cannot be trusted is never returned as a value::

    from ambientd.client import Follower, NoValue, read_file_degC

    try:
        ambient_degC = read_file_degC("/run/ambientd/ambient_temp", max_age_s=5)
    except NoValue as reason:  # Absent, Poisoned, Stale or Malformed
        ambient_degC = 40.0  # whatever is safe without it

    with Follower("/run/ambientd/ambient.sock", max_age_s=5) as follower:
        for reading in follower:  # at least one round every 5 s, whatever the daemon does
            if reading is None or reading.ambient_degC is None:
                act_without_it()
            else:
                act_on(reading.ambient_degC)

Nothing here waits longer than its timeout. A file is read as it is at the moment of the call, and its age is its
modification time's, either way off the wall clock: a clock that was set wrong makes it stale, until the daemon writes
again. The socket's ages are on a clock that never jumps and counts suspend; a wait does not count it.
"""

import math
import os
import select
import stat
import time
from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import socket

STATUSES = ("warming_up", "tracking", "degraded", "coasting", "faulted")
_CLOCK: int = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
_LONGEST_LINE_BYTES = 65536
_LONGEST_FILE_VALUE_BYTES = 15
_COLDEST_DEGC = -273.15
_FIRST_DELAY_S, _LAST_DELAY_S = 0.1, 5.0


class NoValue(Exception):
    """There is no trustworthy value; the message gives the reason."""


class Absent(NoValue):
    """Nothing is there, or it may not be read: the daemon has ended, or has no trustworthy value."""


class Poisoned(NoValue):
    """The daemon's replacement for a value that is not trusted."""


class Stale(NoValue):
    """It is older than it may be."""


class Malformed(NoValue):
    """The content is nothing that the daemon writes."""


class Sensor(NamedTuple):
    """One input of the estimate, in ``unit``; None is missing."""

    unit: str
    raw: float | None
    """As it was read."""
    used: float | None
    """As the estimate took it."""


class Reading(NamedTuple):
    """One tick of the daemon."""

    time_s: float
    """Since boot, suspend included; in a replay, the trace's."""
    model: str
    status: str
    """One of ``STATUSES``."""
    ambient_degC: float | None
    """None where it is ``faulted``."""
    low_degC: float | None
    high_degC: float | None
    level_percent: int
    """The share of errors that low to high covers."""
    age_s: float | None
    """Since the estimate last used current readings alone; None where it never did."""
    sensors: Mapping[str, Sensor]


def read_file_degC(
    path: str, max_age_s: float, poison_millidegC: int | None = None, offset_millidegC: int = 0
) -> float:
    """The ambient in a ``file:`` publication, in degC; raises :class:`NoValue`.

    ``poison_millidegC`` and ``offset_millidegC`` are the publication's; what is below absolute zero is poison, too.
    """
    content = _fresh_content(path, max_age_s, _LONGEST_FILE_VALUE_BYTES)
    digits = content.rstrip(b"\n").removeprefix(b"-")
    # int() would take a blank, a plus and an underscore, too
    if not content.endswith(b"\n") or not digits.isdigit():
        raise Malformed(f"{path}: holds {content!r}")
    millidegC = int(content)
    if millidegC == poison_millidegC:
        raise Poisoned(f"{path}: holds {millidegC}, the poison")
    ambient_degC = (millidegC - offset_millidegC) / 1000
    if ambient_degC < _COLDEST_DEGC:
        raise Poisoned(f"{path}: holds {millidegC}, below absolute zero")
    return ambient_degC


def read_status(path: str, max_age_s: float) -> Reading:
    """The newest tick in a ``status:`` publication; raises :class:`NoValue`. It may be ``faulted``."""
    content = _fresh_content(path, max_age_s, _LONGEST_LINE_BYTES)
    try:
        return parse_reading(content)
    except ValueError as error:
        raise Malformed(f"{path}: {error}") from error


def _fresh_content(path: str, max_age_s: float, longest_bytes: int) -> bytes:
    try:
        # a pipe in its place would make a plain open() wait for ever
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        try:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode):
                raise Malformed(f"{path}: is no regular file")
            content = os.read(descriptor, longest_bytes + 1)
        finally:
            os.close(descriptor)
    except OSError as error:
        raise Absent(f"{path}: {error.strerror or error}") from error
    age_s = time.time() - found.st_mtime
    if not abs(age_s) <= max_age_s:
        raise Stale(f"{path}: is {age_s:.1f} s old")
    if len(content) > longest_bytes:
        raise Malformed(f"{path}: is longer than {longest_bytes} bytes")
    return content


def parse_reading(line: bytes) -> Reading:
    """The reading in one line of the socket or in the status file; raises ValueError, 'what is wrong'."""
    import json  # reading the file needs none of it

    try:
        # its text is decoded here: json would take UTF-16, and so half a line, for something else
        return _reading(json.loads(line.decode()))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"is no reading ({type(error).__name__}: {error})"[:200]) from error


def _reading(data: Any) -> Reading:
    # unknown keys are ignored: a later daemon may add some
    reading = Reading(
        time_s=_number(data["time_s"]),
        model=_text(data["model"]),
        status=_text(data["status"]),
        ambient_degC=_number_or_none(data["ambient_degC"]),
        low_degC=_number_or_none(data["low_degC"]),
        high_degC=_number_or_none(data["high_degC"]),
        level_percent=int(_number(data["level_percent"])),
        age_s=_number_or_none(data["age_s"]),
        sensors={
            name: Sensor(_text(each["unit"]), _number_or_none(each["raw"]), _number_or_none(each["used"]))
            for name, each in data["sensors"].items()
        },
    )
    if reading.status not in STATUSES:
        raise ValueError(f"unknown status {reading.status!r}")
    values = (reading.ambient_degC, reading.low_degC, reading.high_degC)
    if any((value is None) != (reading.status == "faulted") for value in values):
        raise ValueError(f"{reading.status} with ambient_degC {reading.ambient_degC}")
    if reading.ambient_degC is not None and reading.ambient_degC < _COLDEST_DEGC:
        raise ValueError(f"{reading.ambient_degC} degC is below absolute zero")
    return reading


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _number_or_none(value: Any) -> float | None:
    return None if value is None else _number(value)


def clock_s() -> float:
    """The clock of a :class:`Follower`: it never jumps, and counts suspend where the system does."""
    return time.clock_gettime(_CLOCK)


class Follower:
    """Follows a ``socket:`` publication, over restarts of the daemon; a context, and an iterator.

    A reading's age counts from its arrival. One that had to wait for its consumer has the age that its ``time_s`` has
    relative to those of the same connection that had not (a replay slower than its trace therefore looks stale). A line
    that is no reading is skipped and counted in ``skipped``; a connection that sends 64 KiB without a line is closed.
    After ``max_age_s`` without anything newer the newest is :class:`Stale`, whatever the reason.
    """

    def __init__(self, path: str, max_age_s: float) -> None:
        self.path = path
        self.max_age_s = max_age_s
        self.problem = "not connected yet"
        """Why there is no connection; empty where there is one."""
        self.skipped = 0
        self._newest: Reading | None = None
        self._born_s = -math.inf
        self._connection: socket.socket | None = None
        self._rest = b""
        self._waiting: list[Reading] = []
        self._empty_s = -math.inf
        """When the connection was last empty."""
        self._offset_s = math.inf
        """From ``time_s`` to the clock, for what did not wait."""
        self._delay_s = _FIRST_DELAY_S
        self._retry_s = -math.inf

    @property
    def age_s(self) -> float:
        """How old the newest reading is now; infinite where there never was one."""
        return clock_s() - self._born_s

    def newest(self) -> Reading:
        """The newest reading that :meth:`wait` returned; raises :class:`Stale`, or :class:`Absent` where none came."""
        if self._newest is None:
            raise Absent(f"{self.path}: {self.problem or 'nothing was received yet'}")
        if not self.age_s <= self.max_age_s:
            raise Stale(f"{self.path}: the newest is {self.age_s:.1f} s old{self.problem and f' ({self.problem})'}")
        return self._newest

    def wait(self, timeout_s: float) -> Reading | None:
        """The next reading that is not stale, None where none came in ``timeout_s``; connects where that is needed."""
        end_s = clock_s() + timeout_s
        while True:
            while self._waiting:
                self._newest = self._waiting.pop(0)
                self._born_s = self._empty_s if self._offset_s == math.inf else self._newest.time_s + self._offset_s
                if self.age_s <= self.max_age_s:
                    return self._newest
            now_s = clock_s()
            if self._connection is None and now_s >= self._retry_s:
                self._connect(now_s)
            left_s = max(0.0, end_s - now_s)
            if self._connection is None:
                time.sleep(max(0.0, min(left_s, self._retry_s - now_s)))
            else:
                self._receive(self._connection, left_s)
            if not self._waiting and clock_s() >= end_s:
                return None

    def __iter__(self) -> Iterator[Reading | None]:
        """Each reading as it comes; None when the newest becomes stale, and then every ``max_age_s``."""
        while True:
            fresh_for_s = self.max_age_s - self.age_s
            yield self.wait(fresh_for_s if fresh_for_s > 0 else self.max_age_s)

    def close(self) -> None:
        """Close the connection."""
        self._leave("closed", clock_s())

    def __enter__(self) -> "Follower":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _connect(self, now_s: float) -> None:
        import socket  # reading files needs none of it

        self._rest = b""
        self._empty_s = now_s
        self._offset_s = math.inf
        try:
            self._connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._connection.setblocking(False)
            self._connection.connect(self.path)
            self.problem = ""
        except (OSError, ValueError) as error:
            self._leave(getattr(error, "strerror", None) or str(error), now_s)

    def _leave(self, problem: str, now_s: float) -> None:
        """Close the connection, and retry ever more rarely until something is received again."""
        if self._connection is not None:
            self._connection.close()
        self._connection = None
        self.problem = problem
        self._retry_s = now_s + self._delay_s
        self._delay_s = min(2 * self._delay_s, _LAST_DELAY_S)

    def _receive(self, connection: "socket.socket", timeout_s: float) -> None:
        """Receive what is there, or what comes in ``timeout_s``."""
        ready = select.poll()
        ready.register(connection, select.POLLIN)
        at_once = not ready.poll(0)  # what comes now did not wait
        if at_once:
            self._empty_s = clock_s()
            if not ready.poll(math.ceil(min(timeout_s, 3600.0) * 1000)):
                return
        try:
            received = connection.recv(_LONGEST_LINE_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            return self._leave(error.strerror or str(error), clock_s())
        if not received:  # a line begun is dropped
            return self._leave("the daemon has ended", clock_s())
        *lines, self._rest = (self._rest + received).split(b"\n")
        now_s = clock_s()
        for line in lines:
            self._parse(line, now_s if at_once else math.inf)
        if len(self._rest) > _LONGEST_LINE_BYTES:
            self._leave("what is received has no lines", clock_s())

    def _parse(self, line: bytes, came_s: float) -> None:
        try:
            reading = parse_reading(line)
        except ValueError:
            self.skipped += 1
            return
        self._delay_s = _FIRST_DELAY_S
        self._offset_s = min(self._offset_s, came_s - reading.time_s)
        self._waiting.append(reading)
