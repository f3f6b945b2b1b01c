"""A process that is left when the program that runs a campaign is killed; it sends the chamber to its safe set point.

It waits at the end of a pipe. ``done`` on it releases the watchdog; its end without that is the death of the program.
"""

from __future__ import annotations

import errno
import json
import subprocess
import sys
import time
from types import TracebackType

from ambient_trainer.laboratory.instruments import ChamberDriver, ChamberSettings, instrument
from ambient_trainer.laboratory.messages import Clock, InstrumentError
from ambient_trainer.laboratory.set_point_limits import SetPointLimits
from ambient_trainer.laboratory.workers import Target

_RELEASE = b"done\n"
_RETRY_S = 1.0
_LONGEST_S = 3600.0
_BUSY_TIMES = 4
"""A port that is in use for so long has a collector again, which sees to the chamber; once, it may still be closing."""


class Watchdog:
    """A watchdog over the chamber for the time of a ``with`` block."""

    def __init__(self, chamber: ChamberSettings, safe_degC: float) -> None:
        self._taken_over = False
        self.argv = [sys.executable, "-m", __name__, chamber.model_dump_json(), repr(safe_degC)]

    def __enter__(self) -> Watchdog:
        # a session of its own: what ends this one does not end it
        self.process = subprocess.Popen(
            self.argv,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release it, as the run has seen to the chamber itself; but not after an error or ``take_over``."""
        assert self.process.stdin is not None
        if self._taken_over or kind is not None:
            self.process.stdin.close()
        else:
            self.process.communicate(_RELEASE)

    def take_over(self) -> None:
        """Have it see to the chamber once the block ends."""
        self._taken_over = True


def make_safe(chamber: ChamberDriver, safe_degC: float) -> None:
    """Send the set point until the chamber confirms it, or another program has it.

    A stopped chamber stays stopped: it may have an alarm.
    """
    end_s = time.monotonic() + _LONGEST_S
    busy = 0
    while time.monotonic() < end_s and busy < _BUSY_TIMES:
        try:
            reading = chamber.read()
            if Target(None).confirmed_by(reading) or Target(safe_degC).confirmed_by(reading):
                return
            chamber.set_point(safe_degC)
        except InstrumentError as error:
            in_use = getattr(error.__cause__, "errno", None) == errno.EWOULDBLOCK
            busy = busy + 1 if in_use else 0
            time.sleep(_RETRY_S)


def main() -> None:
    """Watch the pipe on standard input."""
    data, safe = json.loads(sys.argv[1]), float(sys.argv[2])
    kind = instrument(data["kind"])
    limits = SetPointLimits(data["port"], safe - 0.1, safe + 0.1)
    chamber = kind.Driver(kind.Settings.model_validate(data), Clock(), limits)
    if sys.stdin.buffer.read() != _RELEASE:
        make_safe(chamber, safe)
        chamber.close()


if __name__ == "__main__":
    main()
