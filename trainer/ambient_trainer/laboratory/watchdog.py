"""A process that is left when the program that runs a campaign is killed; it sends the chamber to its safe set point.

It waits at the end of a pipe. ``done`` on it releases the watchdog; its end without that is the death of the program.
Then it holds the chamber as a run does at its end, at the same pace, lifts the gradients, and writes down each step.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import subprocess
import sys

from ambient_trainer.laboratory.instruments import ChamberDriver, ChamberLimits, ChamberSettings, instrument
from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError
from ambient_trainer.laboratory.workers import ChamberControl, Target

_RELEASE = b"done\n"
_RETRY_S = 1.0
_LONGEST_S = 3600.0
_BUSY_TIMES = 4
"""A port that is in use for so long has a collector again, which sees to the chamber; once, it may still be closing."""
_SILENT_TIMES = 3  # after so many questions without an answer the set point is sent all the same
_MOST_DEATHS = 3  # of the watchdog itself: whatever ends it goes on
_log = logging.getLogger("ambient_trainer.laboratory")


class Watchdog:
    """A watchdog over the chamber for the time of a ``with`` block; ``log_path`` gets its steps where it acts."""

    def __init__(self, chamber: ChamberSettings, safe: Target, log_path: str) -> None:
        self._taken_over, self._deaths = False, 0
        order = {"chamber": chamber.model_dump(), "safe": safe, "log": log_path}
        self.argv = [sys.executable, "-m", __name__, json.dumps(order)]

    def __enter__(self) -> Watchdog:
        self._start()
        return self

    def _start(self) -> None:
        # a session of its own: what ends this one does not end it
        pipe, silent = subprocess.PIPE, subprocess.DEVNULL
        self.process = subprocess.Popen(self.argv, stdin=pipe, stdout=silent, stderr=silent, start_new_session=True)

    def check(self) -> str | None:
        """Start it again where it has died; returns what to say of that, and raises OSError once it died too often."""
        if (status := self.process.poll()) is None:
            return None
        self._deaths += 1
        self._let_go()
        self._start()
        died = f"the watchdog over the chamber has died (status {status})"
        if self._deaths > _MOST_DEATHS:
            raise OSError(f"{died}, {self._deaths} times by now: nothing may be left to see to the chamber")
        return f"{died}, and was started again"

    def _let_go(self) -> None:
        """End the pipe without a release."""
        assert self.process.stdin is not None
        self.process.stdin.close()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Release it, as the run has seen to the chamber itself; but not after an error or ``take_over``."""
        if self._taken_over or kind is not None:
            with contextlib.suppress(OSError):  # the outcome says that the chamber is not safe
                self.check()
            self._let_go()
        else:
            self.process.communicate(_RELEASE)

    def take_over(self) -> None:
        """Have it see to the chamber once the block ends."""
        self._taken_over = True


def make_safe(chamber: ChamberDriver, period_s: float, safe: Target) -> str:
    """Send the set point until the chamber confirms it, or another program has it; returns how it ended."""
    clock = Clock()
    control = ChamberControl(chamber, clock, lambda message: _log.info("%s", message), period_s, safe, 60.0)
    busy = silent = 0
    while clock.now_s() < _LONGEST_S and busy < _BUSY_TIMES:
        due_s, error = clock.now_s() + _RETRY_S, None
        try:
            if silent < _SILENT_TIMES:
                if Target(None).confirmed_by(chamber.read()):  # it may have an alarm
                    return "the chamber is stopped, and stays so"
                silent = _SILENT_TIMES
            due_s, error = control.turn(), control.error
        except InstrumentError as failure:
            error, silent = failure, silent + (not isinstance(failure, Disconnected))
        if control.settled:
            return f"the chamber confirmed {safe}"
        busy = busy + 1 if getattr(getattr(error, "__cause__", None), "errno", None) == errno.EWOULDBLOCK else 0
        chamber.close()  # a collector that is started again may have it
        clock.sleep(due_s - clock.now_s())
    return "another program has the chamber" if busy else f"the chamber has not confirmed {safe}"


def main() -> None:
    """Watch the pipe on standard input."""
    order = json.loads(sys.argv[1])
    kind, safe, safe_degC = instrument(order["chamber"]["kind"]), Target(*order["safe"]), order["safe"][0]
    settings = kind.Settings.model_validate(order["chamber"])
    chamber = kind.Driver(settings, Clock(), ChamberLimits(low_degC=safe_degC - 0.1, high_degC=safe_degC + 0.1))
    if sys.stdin.buffer.read() != _RELEASE:
        with contextlib.suppress(OSError):  # the chamber matters more
            logging.basicConfig(filename=order["log"], format="%(asctime)s %(message)s", level=logging.INFO)
        _log.info("the program that ran the campaign has ended without a word: the chamber goes to %g degC", safe_degC)
        _log.info("%s", make_safe(chamber, settings.period_s, safe))
        chamber.close()


if __name__ == "__main__":
    main()
