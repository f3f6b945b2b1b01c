"""A shell on the device stays open: a question is a command to it, the answer one marked line back.

``adb shell``, ``ssh`` and this machine's own ``sh`` all speak POSIX shell on a pipe. What else they print, such as
``error: no devices/emulators found``, is kept for the message of the failure that follows.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Mapping
from typing import NamedTuple

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.line import LineError, Silent, Unplugged

_CHUNK = 1 << 16
_MOST_WORDS = 200
_LONGEST = 1 << 20


class NotHere(Unplugged):
    """The program that reaches the device cannot be started."""

    mend = "install it, or see that it is on the PATH"


class Way(NamedTuple):
    """How a shell on the device is reached."""

    argv: tuple[str, ...]
    label: str
    """Names the way in messages."""
    environment: Mapping[str, str]
    """Added to this process's own."""


class Answer(NamedTuple):
    """What a command left in ``$answer``, with when it was asked and answered, in the clock's seconds."""

    asked_s: float
    answered_s: float
    text: str
    status: int
    """The exit status of the command."""


def way_to(connect: str, environment: Mapping[str, str] | None = None) -> Way:
    """The way that a campaign's ``connect`` names."""
    kind, _, whom = connect.partition(" ")
    argv: tuple[str, ...] = ("sh",)
    if kind == "adb":
        argv = ("adb", *(("-s", whom) if whom else ()), "shell", "-T", "sh")
    elif kind == "ssh":
        options = ("BatchMode=yes", "ConnectTimeout=10", "ServerAliveInterval=5", "ServerAliveCountMax=2")
        argv = ("ssh", "-T", *(part for each in options for part in ("-o", each)), whom, "sh")
    return Way(argv, connect, environment or {})


class Shell:
    """One shell, opened by the first question; any failure closes it, and the next question opens another.

    ``setup`` is run in each that opens. Raises :class:`Unplugged` where the shell cannot be had or ended, and
    :class:`Silent` where no answer came within ``timeout_s``.
    """

    def __init__(self, way: Way, clock: Clock, timeout_s: float, setup: str = "") -> None:
        self.way = way
        self.opened = 0
        """How many have been opened."""
        self._clock = clock
        self._timeout_s = timeout_s
        self._setup = setup
        self._process: subprocess.Popen[bytes] | None = None
        self._received = b""
        self._words = b""
        self._asked = 0

    @property
    def alive(self) -> bool:
        """Whether it is open and has not ended."""
        return self._process is not None and self._process.poll() is None

    def ask(self, command: str) -> Answer:
        """Run ``command``, whose standard input is empty, and give what it left in ``$answer``."""
        try:
            if self._process is None:
                self._start()
                self._exchange(self._setup or ":")
            return self._exchange(command)
        except LineError:
            self.close()
            raise

    def close(self) -> None:
        """End it, and all that still runs in its session here."""
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):  # what was never sent cannot be flushed
                assert pipe is not None
                pipe.close()

    def _start(self) -> None:
        argv = self.way.argv
        try:
            self._process = subprocess.Popen(
                argv,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, **self.way.environment},
                bufsize=0,
                # Ctrl-C is this program's business: actions have to be stopped over this shell
                start_new_session=True,
            )
        except OSError as error:
            raise NotHere("device", self.way.label, f"to start {argv[0]}", f"{error.strerror}") from error
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            os.set_blocking(pipe.fileno(), False)
        self._received = self._words = b""
        self.opened += 1

    def _exchange(self, command: str) -> Answer:
        self._asked += 1
        mark = b"=%d " % self._asked
        text = f'answer=\n{{\n{command}\n}} </dev/null\necho "={self._asked} $? $answer"\n'
        deadline_s = time.monotonic() + self._clock.patience_s(self._timeout_s)
        asked_s = self._clock.now_s()
        self._send(text.encode(), deadline_s)
        while True:
            line = self._line(deadline_s)
            # what stands before it is a prompt, and what is echoed has no number there
            _, marked, rest = line.rpartition(mark)
            status, _, answer = rest.partition(b" ")
            if marked and status.isdigit():
                return Answer(asked_s, self._clock.now_s(), answer.decode("utf-8", "replace"), int(status))
            self._words = (self._words + b" " + line)[-_MOST_WORDS:]

    def _send(self, data: bytes, deadline_s: float) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        pipe = self._process.stdin.fileno()
        while data:
            self._ready(pipe, selectors.EVENT_WRITE, deadline_s)
            try:
                data = data[os.write(pipe, data) :]
            except BlockingIOError:
                continue
            except OSError:
                self._listen_once_more()
                raise self._ended() from None

    def _listen_once_more(self) -> None:
        """Take what it said before it ended, for the message."""
        assert self._process is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):  # it is said already, or never
            self._words += b" " + os.read(self._process.stdout.fileno(), _CHUNK)[-_MOST_WORDS:].replace(b"\n", b" ")

    def _line(self, deadline_s: float) -> bytes:
        """The next line, without its end; a pseudo-terminal ends lines with a carriage return, too."""
        assert self._process is not None
        assert self._process.stdout is not None
        pipe = self._process.stdout.fileno()
        while b"\n" not in self._received:
            self._ready(pipe, selectors.EVENT_READ, deadline_s)
            try:
                chunk = os.read(pipe, _CHUNK)
            except BlockingIOError:
                continue
            except OSError:
                chunk = b""
            if not chunk or len(self._received) > _LONGEST:
                self._words += b" " + self._received[-_MOST_WORDS:]
                raise self._ended()
            self._received += chunk
        line, _, self._received = self._received.partition(b"\n")
        return line.rstrip(b"\r")

    def _ready(self, pipe: int, event: int, deadline_s: float) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(pipe, event)
            if not selector.select(max(deadline_s - time.monotonic(), 0.0)):
                problem = f"nothing in {self._timeout_s:g} s{self._said()}"
                raise Silent("device", self.way.label, "an answer", problem)

    def _ended(self) -> Unplugged:
        return Unplugged("device", self.way.label, "an answer", f"the end of the shell{self._said()}")

    def _said(self) -> str:
        words = self._words.decode("utf-8", "replace").strip()
        return f" ({words})" if words.isprintable() and words else ""
