"""A serial line on which an answer is taken only for the query it belongs to.

An instrument answers in the order in which it was asked, so a line is synchronised when no answer is due. It is not
when it was just opened, and after every failure. Then what comes is thrown away, and the synchronisation query is sent,
whose answer no other query has. Once that came, whatever was late has come before it. On a synchronised line anything
that comes unasked is an error, as is an answer that is cut short, doubled or another instrument's.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import select
import termios
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import serial  # type: ignore[import-untyped]

from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError, NoResponse

QUIET_S = 0.02
"""Silence for so long ends an answer: many bytes at the bauds of instruments, and more than an adapter holds back."""
_PORT_ERRORS = (OSError, ValueError, TypeError, termios.error)
"""What a port raises that is not there, or not any more; TypeError is pyserial's, of a descriptor that it has lost."""
_BETWEEN_S = 0.05
_MOST_SHOWN = 48
_NETWORK = "is it on the network, is this its address and port, and is no other program connected?"
_FOREIGN = re.compile(rb"[^\x20-\x7e]")


class Malformed(NamedTuple):
    """Bytes that are no reply of the protocol: what it would have had there, and what was there."""

    expected: str
    got: str


Decode = Callable[[bytes], tuple[list[Any], bytes]]
"""From the bytes that came so far: the replies that are whole, what is none, and the bytes of the next reply."""


class Query(NamedTuple):
    """What is sent, its answer in words for a message, and whether a reply is that answer."""

    request: bytes
    expected: str
    is_answer: Callable[[Any], bool]


class Answer(NamedTuple):
    """A reply, with when it was asked for and when it came."""

    asked_s: float
    answered_s: float
    reply: Any


def text_replies(ending: bytes, ignored: bytes, longest: int, parse: Callable[[str], Any]) -> Decode:
    """The decoder of a text protocol: ``parse`` reads each line up to ``ending``, without ``ignored`` at either end.

    Bytes that are no text before a reply are malformed, and never taken for a part of it.
    """

    def malformed(data: bytes) -> Malformed:
        return Malformed(f"at most {longest} characters of text and {shown(ending)}", shown(data))

    def read(line: bytes) -> list[Any]:
        foreign = [match.end() for match in _FOREIGN.finditer(line)]
        if not foreign and len(line) <= longest:
            return [parse(line.decode("ascii"))]
        behind = line[foreign[-1] :] if foreign else b""
        found: list[Any] = [malformed(line[: len(line) - len(behind)])]
        if 0 < len(behind) <= longest:
            found.append(parse(behind.decode("ascii")))
        return found

    def decode(data: bytes) -> tuple[list[Any], bytes]:
        *lines, rest = data.split(ending)
        found = [reply for line in lines for reply in read(line.strip(ignored))]
        rest = rest.lstrip(ignored)
        if len(rest) > longest:
            return [*found, malformed(rest)], b""
        return found, rest

    return decode


def shown(data: bytes) -> str:
    """Bytes for a message: text where they are text, else in hexadecimal; the middle left out of many."""
    if len(data) > _MOST_SHOWN:
        return f"{shown(data[: _MOST_SHOWN // 2])} ... {shown(data[-_MOST_SHOWN // 2 :])} ({len(data)} bytes)"
    if all(0x20 <= byte < 0x7F or byte in b"\r\n" for byte in data):
        return repr(data.decode("ascii"))
    return data.hex(" ").upper()


@dataclass(eq=False)
class SerialLine:
    """One instrument's line; opened by the first query, and again after it was lost.

    ``synchronise_query`` is one whose answer no other query has, or else comes after a silence of ``quiet_s``;
    ``pause_s`` is the least time between two requests; with ``xonxoff`` the instrument stops the sender with XOFF. A
    port may be a URL, such as ``socket://HOST:2049``.
    """

    instrument: str
    settings: Any
    clock: Clock
    decode: Decode
    synchronise_query: Query
    baud: int
    pause_s: float = 0.0
    xonxoff: bool = False
    quiet_s: float = QUIET_S
    _lock: threading.RLock = field(default_factory=threading.RLock, init=False)
    _serial: serial.Serial | None = field(default=None, init=False)
    _synchronised: bool = field(default=False, init=False)
    _synchronisations_due: int = field(default=0, init=False)
    _may_send_s: float = field(default=-float("inf"), init=False)

    @property
    def port(self) -> str:
        """Where the instrument is."""
        return str(self.settings.port)

    def query(self, query: Query) -> Answer:
        """The answer to ``query``; raises :class:`InstrumentError`."""
        with self._lock:
            self.synchronise()
            if any(self.decode(data := self._receive(0.0))):
                raise self._failed(f"nothing before it was asked for {query.expected}", shown(data))
            return self._exchange(query)

    def query_anyway(self, query: Query) -> Answer:
        """The answer to a command that must get through; raises :class:`InstrumentError`.

        It is sent after unasked bytes, and to an instrument that does not answer the synchronisation query: the line
        may be dead in one direction only. The error is raised after that.
        """
        with self._lock:
            self._open()
            if any(self.decode(self._receive(0.0))):
                self._synchronised = False
            try:
                self.synchronise()
            except InstrumentError:
                if self._serial is not None:
                    self._send(query.request)
                raise
            return self._exchange(query)

    def write(self, request: bytes) -> None:
        """Send what has no answer; raises :class:`InstrumentError`."""
        with self._lock:
            self.synchronise()
            self._send(request)

    def synchronise(self) -> Any:
        """Synchronise the line; the answer to the synchronisation query, or None where that was not necessary."""
        with self._lock:
            self._open()
            if self._synchronised:
                return None
            end_s = self._patience_end_s()
            while self._receive(self.quiet_s) and time.monotonic() < end_s:
                pass
            self._send(self.synchronise_query.request)
            self._synchronisations_due += 1
            answer: Any = None
            rest = b""
            end_s = self._patience_end_s()
            while self._synchronisations_due and (data := self._receive(end_s - time.monotonic())):
                replies, rest = self.decode(rest + data)
                for reply in replies:
                    if not isinstance(reply, Malformed) and self.synchronise_query.is_answer(reply):
                        self._synchronisations_due -= 1
                        answer = reply
            if answer is None:
                raise self._missing(self.synchronise_query, rest)
            self._synchronisations_due = 0
            self._synchronised = True
            return answer

    def close(self) -> None:
        """Close the port; the next query opens it again."""
        with self._lock:
            if self._serial is not None:
                port, self._serial = self._serial, None
                with contextlib.suppress(*_PORT_ERRORS):
                    port.reset_output_buffer()  # else closing waits for an instrument that sent XOFF
                with contextlib.suppress(*_PORT_ERRORS):
                    port.close()  # an adapter that is still held comes back under another number
            self._synchronised = False

    def _patience_end_s(self) -> float:
        return time.monotonic() + self.clock.patience_s(self.settings.timeout_s)

    def _exchange(self, query: Query) -> Answer:
        asked_s = self._send(query.request)
        end_s = self._patience_end_s()
        replies: list[Any] = []
        rest = b""
        while not replies:
            data = self._receive(end_s - time.monotonic())
            answered_s = self.clock.now_s()
            if not data:
                raise self._missing(query, rest)
            replies, rest = self.decode(rest + data)
        first, *more = replies
        if isinstance(first, Malformed):
            raise self._failed(query.expected, first.got)
        if not query.is_answer(first):
            raise self._failed(query.expected, f"the answer to another question, {first}")
        beyond = rest + self._receive(self.clock.wall_s(QUIET_S))
        if more or any(self.decode(beyond)):
            raise self._failed(f"{query.expected}, and nothing more", f"{first}, and more in {shown(data + beyond)}")
        return Answer(asked_s, answered_s, first)

    def _missing(self, query: Query, rest: bytes) -> InstrumentError:
        if rest:
            return self._failed(query.expected, f"only {shown(rest)} in {self.settings.timeout_s:g} s")
        return self._failed(query.expected, f"nothing in {self.settings.timeout_s:g} s", NoResponse)

    def _failed(self, expected: str, got: str, kind: type[InstrumentError] = InstrumentError) -> InstrumentError:
        self._synchronised = False
        hint = _NETWORK if "://" in self.port and kind is not InstrumentError else None
        return kind(self.instrument, self.port, expected, got, hint)

    def _open(self) -> None:
        if self._serial is not None:
            return
        try:
            port = serial.serial_for_url(
                self.port,
                self.baud,
                timeout=0,
                write_timeout=self.clock.patience_s(self.settings.timeout_s),
                xonxoff=self.xonxoff,
                exclusive=True,  # two instruments on one port would read each other's answers
            )
            if self.xonxoff:  # an XOFF that nobody took back stays with the port: stop it ourselves, and let it go
                port.set_output_flow_control(False)
                port.set_output_flow_control(True)
        except _PORT_ERRORS as error:
            raise self._failed("a port that can be opened", _reason(error), Disconnected) from error
        self._serial = port
        self._synchronisations_due = 0
        self._synchronised = False

    def _send(self, request: bytes) -> float:
        port = self._serial
        assert port is not None, "nothing is sent on a line that is not open"
        time.sleep(max(self._may_send_s - time.monotonic(), 0.0))
        self._may_send_s = time.monotonic() + self.clock.wall_s(self.pause_s)
        asked_s = self.clock.now_s()
        try:
            port.write(request)
        except serial.SerialTimeoutException as error:
            self.close()  # with it goes what was not sent
            raise self._failed(f"{shown(request)} to be taken", "XOFF all the time", NoResponse) from error
        except _PORT_ERRORS as error:
            raise self._lost(error) from error
        return asked_s

    def _receive(self, patience_s: float) -> bytes:
        """The bytes that came, waiting for the first of them at most ``patience_s`` of the machine's seconds."""
        port = self._serial
        assert port is not None, "nothing is received on a line that is not open"
        try:
            if not select.select([port.fileno()], [], [], max(patience_s, 0.0))[0]:
                return b""
            return bytes(port.read(max(port.in_waiting, 1)))
        except _PORT_ERRORS as error:
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> InstrumentError:
        self.close()
        return self._failed("the port to stay", _reason(error), Disconnected)


class SerialDriver:
    """What the drivers of instruments on serial lines share."""

    line: SerialLine
    _between_due_s = -float("inf")

    def ask_between(self, query: Query) -> Answer | None:
        """Ask another question between two readings, so that an instrument which falls one answer behind is noticed.

        It is left out, and None, where the last one is less than 50 ms of the machine ago, as in fast simulations.
        """
        if time.monotonic() < self._between_due_s:
            return None
        self._between_due_s = time.monotonic() + _BETWEEN_S
        return self.line.query(query)

    def close(self) -> None:
        """Give the port back."""
        self.line.close()

    def error(self, expected: str, got: str, hint: str | None = None) -> InstrumentError:
        """An error of this instrument, ready to be raised."""
        return InstrumentError(self.line.instrument, self.line.port, expected, got, hint)


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EWOULDBLOCK:
        return "one that is in use"
    return os.strerror(number) if isinstance(number, int) else str(error)
