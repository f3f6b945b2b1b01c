"""A serial line on which an answer is taken only for the question it belongs to.

An instrument answers in the order in which it was asked, so a line is in step when nothing is left to come. It is out
of step when it was just opened, and after every failure. Then what comes is thrown away, and a marker is asked: a
question whose answer no other question has. Once that came, whatever was late has come before it. In step, anything
that comes unasked is an error, as is an answer that is cut short, doubled or another instrument's.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import threading
import time
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import serial  # type: ignore[import-untyped]

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.protocols.misread import Misread, shown

_QUIET_S = 0.02
"""Silence for so long ends an answer: many bytes at the bauds of instruments, and more than an adapter holds back."""

_GONE = (OSError, ValueError, TypeError, termios.error)
"""What a port raises that is not there, or not any more; TypeError is pyserial's, of a descriptor that it has lost."""

_Reply = TypeVar("_Reply")


class LineError(Exception):
    """An exchange with an instrument that failed; the next one may succeed."""

    mend = "is it the instrument that belongs on this port, and is nobody else speaking to it?"

    def __init__(self, instrument: str, port: str, expected: str, got: str) -> None:
        self.instrument = instrument
        self.port = port
        self.expected = expected
        self.got = got
        super().__init__(instrument, port, expected, got)

    def __str__(self) -> str:
        return f"{self.instrument} on {self.port}: expected {self.expected}, got {self.got}; {self.mend}"


class Unplugged(LineError):
    """The port is not there, is another's, or went while it was in use."""

    mend = "plug it in, or correct the port; it is opened again by itself"


class Silent(LineError):
    """Nothing came in time."""

    mend = "is it switched on, and is this its port and its speed?"


class SwitchedOff(Silent):
    """Silence of an instrument that switches itself off."""

    mend = "switch it on"


class Decoder(Protocol[_Reply]):
    """What comes in, in pieces of any size, to replies."""

    def feed(self, data: bytes) -> list[_Reply | Misread]:
        """The replies that are whole by now, and what is none."""
        ...

    def rest(self) -> bytes:
        """What has come of the next reply."""
        ...


class Question(NamedTuple):
    """What is sent, and what answers it."""

    request: bytes
    expected: str
    """The answer, in words for a message."""
    fits: Callable[[Any], bool]
    """Whether a reply is the answer."""


class Answer(NamedTuple, Generic[_Reply]):
    """A reply, and when."""

    asked_s: float
    answered_s: float
    reply: _Reply


class Line(Generic[_Reply]):
    """One instrument's line; opened when first asked, and again after it was lost."""

    def __init__(
        self,
        instrument: str,
        port: str,
        baud: int,
        decoder: Callable[[], Decoder[_Reply]],
        marker: Question,
        clock: Clock,
        timeout_s: float,
        pause_s: float = 0.0,
        xonxoff: bool = False,
    ) -> None:
        self.instrument = instrument
        self.port = port
        self._baud = baud
        self._decoder = decoder
        self._marker = marker
        self._clock = clock
        self._timeout_s = timeout_s
        self._pause_s = pause_s
        self._xonxoff = xonxoff
        self._lock = threading.RLock()
        self._serial: serial.Serial | None = None
        self._in_step = False
        self._markers_owed = 0
        self._may_send_s = -float("inf")

    def ask(self, question: Question) -> Answer[_Reply]:
        """The answer to ``question``; raises :class:`LineError`."""
        with self._lock:
            self._come_in_step()
            data = self._receive(0.0)
            if data:
                raise self._failed(LineError, f"nothing before it was asked for {question.expected}", shown(data))
            return self._exchange(question)

    def insist(self, question: Question) -> Answer[_Reply]:
        """The answer to a command that must get through; raises :class:`LineError`.

        What came unasked does not keep it from going out, nor does an instrument that does not answer the marker, as
        the line may be dead in one direction only: the error is raised then.
        """
        with self._lock:
            self._open()
            if self._receive(0.0):
                self._in_step = False
            try:
                self._come_in_step()
            except LineError:
                if self._serial is not None:
                    self._send(question.request)
                raise
            return self._exchange(question)

    def tell(self, request: bytes) -> None:
        """Send what has no answer; raises :class:`LineError`."""
        with self._lock:
            self._come_in_step()
            self._send(request)

    def mark(self) -> _Reply | None:
        """The marker's answer where the line is out of step, which brings it in step; None where it is in step."""
        with self._lock:
            return self._come_in_step()

    def close(self) -> None:
        """Give the port back; asking opens it again."""
        with self._lock:
            if self._serial is not None:
                port, self._serial = self._serial, None
                with contextlib.suppress(*_GONE):
                    port.reset_output_buffer()  # else closing waits for an instrument that holds its hand up
                with contextlib.suppress(*_GONE):
                    port.close()  # an adapter that is still held comes back under another number
            self._in_step = False

    def _exchange(self, question: Question) -> Answer[_Reply]:
        decoder = self._decoder()
        asked_s = self._send(question.request)
        end_s = time.monotonic() + self._clock.patience_s(self._timeout_s)
        while True:
            data = self._receive(end_s - time.monotonic())
            answered_s = self._clock.now_s()
            if not data:
                raise self._missing(question, decoder.rest())
            replies = decoder.feed(data)
            if not replies:
                continue
            first, *more = replies
            if isinstance(first, Misread):
                raise self._failed(LineError, question.expected, first.got)
            if not question.fits(first):
                raise self._failed(LineError, question.expected, f"the answer to another question, {first}")
            beyond = self._receive(self._clock.wall_s(_QUIET_S))
            if more or decoder.rest() or beyond:
                raise self._failed(
                    LineError, f"{question.expected}, and nothing more", f"{first}, and more in {shown(data + beyond)}"
                )
            return Answer(asked_s, answered_s, first)

    def _come_in_step(self) -> _Reply | None:
        self._open()
        if self._in_step:
            return None
        decoder = self._decoder()
        end_s = time.monotonic() + self._clock.patience_s(self._timeout_s)
        while self._receive(_QUIET_S) and time.monotonic() < end_s:
            pass
        self._send(self._marker.request)
        self._markers_owed += 1
        answer: _Reply | None = None
        end_s = time.monotonic() + self._clock.patience_s(self._timeout_s)
        while self._markers_owed:
            data = self._receive(end_s - time.monotonic())
            if not data:
                break
            for reply in decoder.feed(data):
                if not isinstance(reply, Misread) and self._marker.fits(reply):
                    self._markers_owed -= 1
                    answer = reply
        if answer is None:
            raise self._missing(self._marker, decoder.rest())
        self._markers_owed = 0
        self._in_step = True
        return answer

    def _missing(self, question: Question, rest: bytes) -> LineError:
        if rest:
            return self._failed(LineError, question.expected, f"only {shown(rest)} in {self._timeout_s:g} s")
        return self._failed(Silent, question.expected, f"nothing in {self._timeout_s:g} s")

    def _failed(self, kind: type[LineError], expected: str, got: str) -> LineError:
        self._in_step = False
        return kind(self.instrument, self.port, expected, got)

    def _open(self) -> None:
        if self._serial is not None:
            return
        try:
            port = serial.Serial(
                self.port,
                self._baud,
                timeout=0,
                write_timeout=self._clock.patience_s(self._timeout_s),
                xonxoff=self._xonxoff,
                exclusive=True,  # two instruments on one port would read each other's answers
            )
            if self._xonxoff:  # an XOFF that nobody took back stays with the port: stop it ourselves, and let it go
                port.set_output_flow_control(False)
                port.set_output_flow_control(True)
        except _GONE as error:
            raise self._failed(Unplugged, "a port that can be opened", _reason(error)) from error
        self._serial = port
        self._markers_owed = 0
        self._in_step = False

    def _send(self, request: bytes) -> float:
        port = self._serial
        assert port is not None, "nothing is sent on a line that is not open"
        self._clock.sleep(self._may_send_s - self._clock.now_s())
        self._may_send_s = self._clock.now_s() + self._pause_s
        asked_s = self._clock.now_s()
        try:
            port.write(request)
        except serial.SerialTimeoutException as error:
            self.close()  # with it goes what was not sent
            raise self._failed(
                Silent, f"{shown(request)} to be taken", "its hand held up (XOFF) all the time"
            ) from error
        except _GONE as error:
            raise self._lost(error) from error
        return asked_s

    def _receive(self, patience_s: float) -> bytes:
        """What came, waiting for its first byte at most ``patience_s`` of the machine's seconds."""
        port = self._serial
        assert port is not None, "nothing is received on a line that is not open"
        try:
            if not select.select([port.fileno()], [], [], max(patience_s, 0.0))[0]:
                return b""
            return bytes(port.read(max(port.in_waiting, 1)))
        except _GONE as error:
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> LineError:
        self.close()
        return self._failed(Unplugged, "the port to stay", _reason(error))


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EWOULDBLOCK:
        return "one that is in use"
    return os.strerror(number) if isinstance(number, int) else str(error)
