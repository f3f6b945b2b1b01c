"""Notifications to the service manager by systemd's ``sd_notify`` protocol; only a completed tick feeds the watchdog.

One datagram of ``NAME=value`` lines to the socket that ``NOTIFY_SOCKET`` names. Sending never waits: what the socket
does not take is sent with the next notification, its newest value only.
"""

import os
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket

_MOST_STATUS_CHARACTERS = 200


class Notifier:
    """Notifies the service manager that ``environment`` names, if any.

    ``note`` takes one message where the manager cannot be reached.
    """

    def __init__(self, environment: Mapping[str, str], note: Callable[[str], None]) -> None:
        self._note = note
        self._pending: dict[str, str] = {}
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

    @property
    def is_open(self) -> bool:
        """Whether a manager is notified."""
        return self._socket is not None

    def _open(self) -> None:
        if self._address[0] not in "/@":
            self._note(f"NOTIFY_SOCKET is '{self._address}', no path and no abstract name: the manager is not notified")
            self.watchdog_s = None
            return
        import socket  # costs a device without a service manager nothing

        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def expect(self, period_s: float) -> None:
        """Warn where ticks ``period_s`` apart are too rare for the watchdog."""
        if self.watchdog_s is not None and period_s > self.watchdog_s / 2:
            self._note(
                f"the watchdog of {self.watchdog_s:g} s is too short for ticks {period_s:g} s apart;"
                f" set WatchdogSec= to {2 * period_s:g} s or more"
            )

    def ready(self, status: str) -> None:
        """It runs, or it runs again after a reload."""
        self._status = status
        self._send({"READY": "1", "STATUS": _line(status)})

    def status(self, text: str) -> None:
        """What it does, in one line for people; the same again is not sent."""
        if text != self._status:
            self._status = text
            self._send({"STATUS": _line(text)})

    def ticked(self, now_s: float) -> None:
        """A tick is done: the watchdog is fed, at most four times in its interval."""
        if self.watchdog_s is not None and now_s - self._alive_s >= self.watchdog_s / 4:
            self._alive_s = now_s
            self._send({"WATCHDOG": "1"})
        elif self._pending:
            self._send({})

    def reloading(self) -> None:
        """It begins to reload; :meth:`ready` ends that."""
        microseconds = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self._send({"RELOADING": "1", "MONOTONIC_USEC": str(microseconds)})

    def stopping(self) -> None:
        """It begins to end."""
        self._send({"STOPPING": "1", "STATUS": "stopping"})

    def __enter__(self) -> "Notifier":
        return self

    def __exit__(self, *error: object) -> None:
        self.stopping()
        self.close()

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, assignments: dict[str, str]) -> None:
        if self._socket is None:
            return
        self._pending.update(assignments)
        message = "\n".join(f"{name}={value}" for name, value in self._pending.items())
        try:
            self._socket.sendto(message.encode(), self._target)
        except OSError as error:
            if not self._failed:
                self._failed = True
                self._note(f"{self._address}: the service manager cannot be notified ({error.strerror or error})")
        else:
            self._pending = {}


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """The watchdog's interval, where there is one and it is meant for this process."""
    microseconds = environment.get("WATCHDOG_USEC", "")
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    return int(microseconds) / 1e6 if microseconds.isascii() and microseconds.isdigit() and int(microseconds) else None


def _line(text: str) -> str:
    return text.replace("\n", " ")[:_MOST_STATUS_CHARACTERS]
