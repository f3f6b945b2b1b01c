"""The service manager is told what systemd's ``sd_notify`` protocol has words for; the watchdog hears real ticks alone.

One datagram of ``NAME=value`` lines to the socket that ``NOTIFY_SOCKET`` names. Telling never waits: what the socket
does not take is owed, and goes out with what is told next, its newest value only.
"""

import os
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket

_MOST_STATUS_CHARACTERS = 200


class Notifier:
    """What ``environment`` says of the service manager; without one everything is told to nobody.

    ``note`` is told once where the manager cannot be reached.
    """

    def __init__(self, environment: Mapping[str, str], note: Callable[[str], None]) -> None:
        self._note = note
        self._owed: dict[str, str] = {}
        self._status = ""
        self._failed = False
        self._socket: socket.socket | None = None
        self._address = environment.get("NOTIFY_SOCKET", "")
        # a leading @ stands for the zero byte of an abstract name
        self._target = f"\0{self._address[1:]}" if self._address.startswith("@") else self._address
        self.watchdog_s = _watchdog_s(environment) if self._address else None
        """How long the manager waits for a sign of life; None where it does not."""
        self._alive_s = float("-inf")
        if self._address:
            self._open()

    def _open(self) -> None:
        if self._address[0] not in "/@":
            self._note(f"NOTIFY_SOCKET is '{self._address}', no path and no abstract name: the manager is not told")
            self.watchdog_s = None
            return
        import socket  # costs a device without a service manager nothing

        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def expect(self, period_s: float) -> None:
        """Say so where ticks ``period_s`` apart are too rare for the watchdog."""
        if self.watchdog_s is not None and period_s > self.watchdog_s / 2:
            self._note(
                f"the watchdog of {self.watchdog_s:g} s is too short for ticks {period_s:g} s apart;"
                f" set WatchdogSec= to {2 * period_s:g} s or more"
            )

    def ready(self, status: str) -> None:
        """It runs, or it runs again after a reload."""
        self._status = status
        self._tell({"READY": "1", "STATUS": _line(status)})

    def status(self, text: str) -> None:
        """What it does, in one line for people; the same again is not told."""
        if text != self._status:
            self._status = text
            self._tell({"STATUS": _line(text)})

    def ticked(self, now_s: float) -> None:
        """A tick is done: the watchdog hears of it, four times in its interval and not more."""
        if self.watchdog_s is not None and now_s - self._alive_s >= self.watchdog_s / 4:
            self._alive_s = now_s
            self._tell({"WATCHDOG": "1"})
        elif self._owed:
            self._tell({})

    def reloading(self) -> None:
        """It begins to reload; :meth:`ready` ends that."""
        microseconds = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self._tell({"RELOADING": "1", "MONOTONIC_USEC": str(microseconds)})

    def stopping(self) -> None:
        """It begins to end."""
        self._tell({"STOPPING": "1", "STATUS": "stopping"})

    def close(self) -> None:
        """Let the socket go."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, assignments: dict[str, str]) -> None:
        if self._socket is None:
            return
        self._owed.update(assignments)
        message = "\n".join(f"{name}={value}" for name, value in self._owed.items())
        try:
            self._socket.sendto(message.encode(), self._target)
        except OSError as error:
            if not self._failed:
                self._failed = True
                self._note(f"{self._address}: the service manager cannot be told ({error.strerror or error})")
        else:
            self._owed = {}


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """The watchdog's interval, where there is one and it is meant for this process."""
    microseconds = environment.get("WATCHDOG_USEC", "")
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    return int(microseconds) / 1e6 if microseconds.isascii() and microseconds.isdigit() and int(microseconds) else None


def _line(text: str) -> str:
    return text.replace("\n", " ")[:_MOST_STATUS_CHARACTERS]
