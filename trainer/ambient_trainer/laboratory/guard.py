"""Should the program that runs a campaign be killed, this process is left, and sends the chamber to its safe set point.

It waits at the end of a pipe. A word on it is a farewell; its end without one is the death of who held the other.
"""

from __future__ import annotations

import errno
import subprocess
import sys
import time
from types import TracebackType

from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.line import LineError

_FAREWELL = b"done\n"
_RETRY_S = 1.0
_AGREES_K = 0.06
_LONGEST_S = 3600.0
_BUSY_TIMES = 4
"""A port that is taken for so long has a collector again, which sees to the chamber; once, it may still be let go."""


class Guard:
    """A guard over the chamber at ``port`` for the time of a ``with`` block."""

    def __init__(self, port: str, safe_degC: float, pause_s: float, timeout_s: float) -> None:
        numbers = [repr(each) for each in (safe_degC, pause_s, timeout_s)]
        self._taken_over = False
        self._argv = [sys.executable, "-m", __name__, port, *numbers]

    def __enter__(self) -> Guard:
        # a session of its own: what ends this one does not end it
        self._process = subprocess.Popen(
            self._argv,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Say farewell, as the run has seen to the chamber itself; but not after an error or ``take_over``."""
        assert self._process.stdin is not None
        if self._taken_over or kind is not None:
            self._process.stdin.close()
        else:
            self._process.communicate(_FAREWELL)

    def take_over(self) -> None:
        """Have it see to the chamber once the block ends."""
        self._taken_over = True


def make_safe(chamber: Chamber, safe_degC: float) -> None:
    """Send the set point until the chamber confirms it, or somebody else has it.

    A stopped chamber stays stopped: it may have an alarm.
    """
    end_s = time.monotonic() + _LONGEST_S
    busy = 0
    while time.monotonic() < end_s and busy < _BUSY_TIMES:
        try:
            reading = chamber.read()
            if not reading.running:
                return
            if abs(reading.set_degC - safe_degC) <= _AGREES_K:
                return
            chamber.set_point(safe_degC)
        except LineError as error:
            taken = getattr(error.__cause__, "errno", None) == errno.EWOULDBLOCK
            busy = busy + 1 if taken else 0
            time.sleep(_RETRY_S)


def main() -> None:
    """Watch the pipe on standard input."""
    port, *numbers = sys.argv[1:]
    safe_degC, pause_s, timeout_s = map(float, numbers)
    if sys.stdin.buffer.read() != _FAREWELL:
        chamber = Chamber(port, safe_degC - 0.1, safe_degC + 0.1, pause_s=pause_s, timeout_s=timeout_s)
        make_safe(chamber, safe_degC)
        chamber.close()


if __name__ == "__main__":
    main()
