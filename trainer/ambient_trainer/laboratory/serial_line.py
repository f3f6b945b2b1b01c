"""A serial line on which an answer is taken only for the query it belongs to.

An instrument answers in the order in which it was asked, so a line is synchronised when no answer is due. It is not
when it was just opened, and after every failure. Then what comes is thrown away, and the synchronisation query is sent,
whose answer no other query has. Once that came, whatever was late has come before it. On a synchronised line anything
that comes unasked is an error, as is an answer that is cut short, doubled or another instrument's.
"""

import contextlib
import errno
import os
import re
import select
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import serial  # type: ignore[import-untyped]

from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError, NoResponse

QUIET_S = 0.02
"""Silence for so long ends an answer: many bytes at the bauds of instruments, and more than an adapter holds back."""
_TEXT_PAUSE_S, _LONGEST_TEXT_S = 0.3, 10.0
"""Silence for so long ends a text of several lines, which takes at most so long."""
_BETWEEN_S = 0.05
_MOST_SHOWN = 48
_VISA = "is it listed by 'pyvisa-shell' (list), and does no other program use it?"
_NETWORK = "is it on the network, is this its address and port, and is no other program connected?"
_UP_TO_FOREIGN = re.compile(rb".*[^\x20-\x7e]", re.DOTALL)
_VISA_SERIAL = re.compile(r"^ASRL(/.+)::INSTR$", re.IGNORECASE)
_VISA_SOCKET = re.compile(r"^TCPIP\d*::(.+)::(\d+)::SOCKET$", re.IGNORECASE)


class Malformed(NamedTuple):
    """Bytes that are no reply of the protocol."""

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


def is_missing(port: str) -> bool:
    """Whether ``port`` is a path at which there is nothing; URLs and VISA resources show only when they are opened."""
    return "://" not in port and "::" not in port and not os.path.exists(port)


def text_replies(ending: bytes, ignored: bytes, longest: int, parse: Callable[[str], Any]) -> Decode:
    """The decoder of a text protocol: ``parse`` reads each line up to ``ending``, without ``ignored`` at either end.

    Bytes that are no text before a reply are malformed, and never taken for a part of it.
    """

    def read(line: bytes) -> list[Any]:
        text = _UP_TO_FOREIGN.sub(b"", line)
        noise, text = (line[: len(line) - len(text)], text) if len(text) <= longest else (line, b"")
        found = [Malformed(shown(noise))] if noise else []
        return [*found, parse(text.decode("ascii"))] if text or not noise else found

    def decode(data: bytes) -> tuple[list[Any], bytes]:
        *lines, rest = data.split(ending)
        found, rest = [reply for line in lines for reply in read(line.strip(ignored))], rest.lstrip(ignored)
        return (found, rest) if len(rest) <= longest else ([*found, Malformed(shown(rest))], b"")

    return decode


def shown(data: bytes) -> str:
    """Bytes for a message: text where they are text, else in hexadecimal; the middle left out of many."""
    if len(data) > _MOST_SHOWN:
        return f"{shown(data[: _MOST_SHOWN // 2])} ... {shown(data[-_MOST_SHOWN // 2 :])} ({len(data)} bytes)"
    if all(0x20 <= byte < 0x7F or byte in b"\r\n" for byte in data):
        return repr(data.decode("ascii"))
    return data.hex(" ").upper()


class _SerialPort:
    """A serial line, or a TCP connection in its place."""

    def __init__(self, name: str, baud: int, xonxoff: bool, patience_s: float) -> None:
        # two instruments on one port would read each other's answers
        options = {"timeout": 0, "write_timeout": patience_s, "xonxoff": xonxoff, "exclusive": True}
        self._port = port = serial.serial_for_url(name, baud, **options)
        self.write, self._xonxoff = port.write, xonxoff
        if xonxoff and "://" not in name:  # an XOFF that nobody took back stays with the port: stop it, and let it go
            port.set_output_flow_control(False)
            port.set_output_flow_control(True)

    def read(self, patience_s: float) -> bytes:
        if not select.select([self._port.fileno()], [], [], max(patience_s, 0.0))[0]:
            return b""
        return bytes(self._port.read(max(self._port.in_waiting, 1)))

    def clear(self) -> None:
        """What is under way is read instead."""

    def close(self) -> None:
        if self._xonxoff:  # else closing waits for an instrument that sent XOFF; any other gets all that was sent
            with contextlib.suppress(Exception):
                self._port.reset_output_buffer()
        self._port.close()


class _VisaPort:
    """A VISA resource that exchanges messages, as USBTMC, VXI-11 and GPIB do: only an answer that is due is read."""

    def __init__(self, name: str) -> None:
        try:
            import pyvisa
        except ImportError as error:
            raise OSError("no pyvisa here; install ambientd[visa]") from error
        self._resource: Any = pyvisa.ResourceManager().open_resource(name)
        self._timeout, self._due = pyvisa.constants.StatusCode.error_timeout, False
        self.close = self._resource.close

    def write(self, data: bytes) -> None:
        for line in data.splitlines(keepends=True):  # a message each
            self._resource.write_raw(line)
        self._due = self._due or b"?" in data

    def read(self, patience_s: float) -> bytes:
        if not self._due:
            return b""
        self._resource.timeout = max(1000.0 * patience_s, 1.0)
        try:
            data: bytes = self._resource.read_raw()
        except Exception as error:
            if getattr(error, "error_code", None) == self._timeout:
                return b""
            raise
        self._due = False
        return data

    def clear(self) -> None:
        with contextlib.suppress(Exception):  # some backends cannot
            self._resource.clear()
        self._due = False


@dataclass(eq=False)
class SerialLine:
    """One instrument's line; opened by the first query, and again after it was lost.

    ``synchronise_query`` is one whose answer no other query has, or else comes after a silence of ``quiet_s``;
    ``settings.pause_s`` is the least time between two requests, 0 where there is none; with ``xonxoff`` the instrument
    stops the sender with XOFF; ``silent_hint`` is what to do where it is silent. A port is a path, a URL of pyserial's
    such as ``socket://HOST:2049``, or a VISA resource.
    """

    instrument: str
    settings: Any
    clock: Clock
    decode: Decode
    synchronise_query: Query
    baud: int
    xonxoff: bool = False
    quiet_s: float = QUIET_S
    silent_hint: str | None = None
    _lock: threading.RLock = field(default_factory=threading.RLock, init=False)
    _port: _SerialPort | _VisaPort | None = field(default=None, init=False)
    _synchronised: bool = field(default=False, init=False)
    _synchronisations_due: int = field(default=0, init=False)
    _may_send_s: float = field(default=-float("inf"), init=False)

    def query(self, query: Query) -> Answer:
        """The answer to ``query``; raises :class:`InstrumentError`."""
        with self._lock:
            self.synchronise()
            if any(self.decode(data := self._receive(0.0))):
                raise self.failed(f"nothing before it was asked for {query.expected}", shown(data))
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
                if self._port is not None:
                    self._send(query.request)
                raise
            return self._exchange(query)

    def text(self, request: bytes) -> bytes:
        """All that comes after ``request`` until a silence, nothing where none comes; for text of unknown length."""
        with self._lock:
            self.synchronise()
            self._send(request)
            data, patience_s = b"", self.clock.patience_s(self.settings.timeout_s)
            end_s = time.monotonic() + _LONGEST_TEXT_S
            while (part := self._receive(patience_s)) and time.monotonic() < end_s:
                data, patience_s = data + part, _TEXT_PAUSE_S
            self._synchronised = bool(data) and not part
            return data

    def synchronise(self) -> Any:
        """Synchronise the line; the answer to the synchronisation query, or None where that was not necessary."""
        with self._lock:
            port = self._open()
            if self._synchronised:
                return None
            port.clear()
            end_s = self._patience_end_s()
            while self._receive(self.quiet_s) and time.monotonic() < end_s:
                pass
            self._send(self.synchronise_query.request)
            self._synchronisations_due += 1
            answer, rest, end_s = None, b"", self._patience_end_s()
            while self._synchronisations_due and (data := self._receive(end_s - time.monotonic())):
                replies, rest = self.decode(rest + data)
                for reply in replies:
                    if not isinstance(reply, Malformed) and self.synchronise_query.is_answer(reply):
                        self._synchronisations_due -= 1
                        answer = reply
            if answer is None:
                raise self._missing(self.synchronise_query, rest)
            self._synchronisations_due, self._synchronised = 0, True
            return answer

    def close(self) -> None:
        """Close the port; the next query opens it again."""
        with self._lock:
            port, self._port = self._port, None
            with contextlib.suppress(Exception):  # an adapter that is still held comes back under another number
                if port is not None:
                    port.close()
            self._synchronised = False

    def _patience_end_s(self) -> float:
        return time.monotonic() + self.clock.patience_s(self.settings.timeout_s)

    def _exchange(self, query: Query) -> Answer:
        asked_s, end_s = self._send(query.request), self._patience_end_s()
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
            raise self.failed(query.expected, first.got)
        if not query.is_answer(first):
            raise self.failed(query.expected, f"the answer to another question, {first}")
        beyond = rest + self._receive(self.clock.wall_s(QUIET_S))
        if more or any(self.decode(beyond)):
            raise self.failed(f"{query.expected}, and nothing more", f"{first}, and more in {shown(data + beyond)}")
        return Answer(asked_s, answered_s, first)

    def _missing(self, query: Query, rest: bytes) -> InstrumentError:
        within = f"in {self.settings.timeout_s:g} s"
        if rest:
            return self.failed(query.expected, f"only {shown(rest)} {within}")
        return self.failed(query.expected, f"nothing {within}", NoResponse, self.silent_hint)

    def failed(
        self, expected: str, got: str, kind: type[InstrumentError] = InstrumentError, hint: str | None = None
    ) -> InstrumentError:
        """An error of this instrument, ready to be raised; the line is synchronised before the next query."""
        self._synchronised = False
        if kind in (Disconnected, NoResponse):
            hint = _VISA if "::" in self.settings.port else _NETWORK if "://" in self.settings.port else hint
        return kind(self.instrument, self.settings.port, expected, got, hint)

    def _open(self) -> _SerialPort | _VisaPort:
        if self._port is not None:
            return self._port
        # of VISA's names, those of streams are pyserial's
        name = _VISA_SOCKET.sub(r"socket://\1:\2", _VISA_SERIAL.sub(r"\1", self.settings.port))
        patience_s = self.clock.patience_s(self.settings.timeout_s)
        with self._losing("a port that can be opened"):
            port = _VisaPort(name) if "::" in name else _SerialPort(name, self.baud, self.xonxoff, patience_s)
        self._port, self._synchronisations_due, self._synchronised = port, 0, False
        return port

    def _send(self, request: bytes) -> float:
        port = self._port
        assert port is not None, "nothing is sent on a line that is not open"
        time.sleep(max(self._may_send_s - time.monotonic(), 0.0))
        self._may_send_s = time.monotonic() + self.clock.wall_s(getattr(self.settings, "pause_s", 0.0))
        asked_s = self.clock.now_s()
        with self._losing(f"{shown(request)} to be taken"):
            port.write(request)
        return asked_s

    def _receive(self, patience_s: float) -> bytes:
        """The bytes that came, waiting for the first of them at most ``patience_s`` of the machine's seconds."""
        assert self._port is not None, "nothing is received on a line that is not open"
        with self._losing("the port to stay"):
            data = self._port.read(patience_s)
        return data

    @contextlib.contextmanager
    def _losing(self, expected: str) -> Iterator[None]:
        """Close the port at an error of it, of which pyserial and pyvisa have a dozen kinds, and say what it is."""
        try:
            yield
        except Exception as error:
            self.close()  # with it goes what was not sent
            if isinstance(error, serial.SerialTimeoutException):
                raise self.failed(expected, "XOFF all the time", NoResponse) from error
            number = getattr(error, "errno", None)
            got = os.strerror(number) if isinstance(number, int) else str(error)
            if number == errno.EWOULDBLOCK:
                got = "one that is in use"
            raise self.failed(expected, got, Disconnected) from error


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
