"""A shell on the device stays open: a command is written to it, and one marked line back is its answer.

``adb shell``, ``ssh`` and this machine's own ``sh`` are all POSIX shells on a pipe. What else they print, such as
``error: no devices/emulators found``, is kept for the message of the failure that follows.
"""

import contextlib
import os
import select
import signal
import subprocess
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from ambient_trainer.laboratory.messages import DEVICE, Clock, Disconnected, InstrumentError, NoResponse

_CHUNK = 1 << 16
_MOST_KEPT = 200
_LONGEST = 1 << 20
_SSH_OPTIONS = ("BatchMode=yes", "ConnectTimeout=10", "ServerAliveInterval=5", "ServerAliveCountMax=2")


class Connection(NamedTuple):
    """How a shell on the device is reached: the command, its name in messages, and what is added to the environment."""

    argv: tuple[str, ...]
    label: str
    environment: Mapping[str, str]
    hint: str = "does this command work by hand?"


class Result(NamedTuple):
    """What a command left in ``$answer``, its exit status, and when it was sent and answered in the clock's seconds."""

    asked_s: float
    answered_s: float
    text: str
    status: int


def connection_to(connect: str, environment: Mapping[str, str] | None = None) -> Connection:
    """The connection that a campaign's ``connect`` names."""
    kind, _, whom = connect.partition(" ")
    argv, hint = ["sh"], "does 'sh' work here?"
    if kind == "adb":
        argv = ["adb", *(("-s", whom) if whom else ()), "shell", "-T", "sh"]
        hint = "is it listed as 'device' by 'adb devices' (cable, USB debugging, authorisation)?"
    elif kind == "ssh":
        argv = ["ssh", "-T", *(part for each in _SSH_OPTIONS for part in ("-o", each)), whom, "sh"]
        hint = f"does 'ssh {whom} true' work without a question (network, key, known host)?"
    return Connection(tuple(argv), connect, environment or {}, hint)


class Shell:
    """One shell, opened by the first command; any failure closes it, and the next command opens another.

    ``setup`` is run in each that opens. Raises :class:`Disconnected` where the shell cannot be had or ended, and
    :class:`NoResponse` where no answer came within ``timeout_s``.
    """

    def __init__(self, connection: Connection, clock: Clock, timeout_s: float, setup: str = "") -> None:
        self.label = connection.label
        self._count = 0
        self._connection, self._clock, self._timeout_s, self._setup = connection, clock, timeout_s, setup
        self._process: Any = None

    @property
    def alive(self) -> bool:
        """Whether it is open and has not ended."""
        return self._process is not None and self._process.poll() is None

    def run(self, command: str) -> Result:
        """Run ``command``, whose standard input is empty, and give what it left in ``$answer``."""
        try:
            if self._process is None:
                self._open()
                self._exchange(self._setup or ":")
            return self._exchange(command)
        except InstrumentError:
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
                pipe.close()

    def _open(self) -> None:
        try:
            # a session of its own: Ctrl-C is this program's business, actions have to be stopped over this shell
            pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
            environment = {**os.environ, **self._connection.environment}
            self._process = subprocess.Popen(
                self._connection.argv, **pipes, env=environment, bufsize=0, start_new_session=True
            )
        except OSError as error:
            expected, hint = f"to start {self._connection.argv[0]}", "install it, or see that it is on the PATH"
            raise Disconnected(DEVICE, self.label, expected, f"{error.strerror}", hint) from error
        self._received = self._printed = b""

    def _exchange(self, command: str) -> Result:
        self._count += 1
        mark = b"=%d " % self._count
        text = f'answer=\n{{\n{command}\n}} </dev/null\necho "={self._count} $? $answer"\n'
        end_s = time.monotonic() + self._clock.patience_s(self._timeout_s)
        asked_s = self._clock.now_s()
        # the pipe is empty and holds more than any command; where the shell has ended, that is what is read
        with contextlib.suppress(OSError):
            self._process.stdin.write(text.encode())
        while True:
            line = self._line(end_s)
            # what stands before it is a prompt, and what is echoed has no number there
            _, marked, rest = line.rpartition(mark)
            status, _, answer = rest.partition(b" ")
            if marked and status.isdigit():
                return Result(asked_s, self._clock.now_s(), answer.decode("utf-8", "replace"), int(status))
            self._keep(line)

    def _line(self, end_s: float) -> bytes:
        """The next line, without its end; a pseudo-terminal ends lines with a carriage return, too."""
        output = self._process.stdout
        while b"\n" not in self._received:
            if not select.select([output], [], [], max(end_s - time.monotonic(), 0.0))[0]:
                raise self._failed(NoResponse, f"nothing in {self._timeout_s:g} s")
            chunk = os.read(output.fileno(), _CHUNK)
            if not chunk or len(self._received) > _LONGEST:
                self._keep(self._received)
                raise self._failed(Disconnected, "the end of the shell")
            self._received += chunk
        line, _, self._received = self._received.partition(b"\n")
        return line.rstrip(b"\r")

    def _keep(self, printed: bytes) -> None:
        self._printed = (self._printed + b" " + printed)[-_MOST_KEPT:]

    def _failed(self, kind: type[InstrumentError], got: str) -> InstrumentError:
        printed = self._printed.decode("utf-8", "replace").strip()
        shown = f" ({printed})" if printed.isprintable() and printed else ""
        return kind(DEVICE, self.label, "an answer", f"{got}{shown}", self._connection.hint)
