"""A simulated instrument at the far end of a pseudo-terminal: bytes take the time of their baud, in order."""

import contextlib
import os
import select
import tempfile
import threading
import tty
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ambient_trainer.laboratory.messages import Clock, in_background

XON, XOFF = b"\x11", b"\x13"
_BITS_A_BYTE = 10  # with start and stop bit
_SHORTEST_WAIT_S = 0.0005


class Response(NamedTuple):
    """How long an instrument works on a command, and the bytes of its reply then; b"" is none."""

    duration_s: float
    reply: bytes


class SimulatedInstrument(ABC):
    """An instrument in a thread of its own; its port is a link that outlives the terminal behind it."""

    def __init__(self, name: str, clock: Clock, baud: int) -> None:
        self._stopped = self._ended = False
        self._clock, self._byte_s = clock, _BITS_A_BYTE / baud
        self._folder = tempfile.TemporaryDirectory(prefix="ambient-laboratory-")
        self._link = Path(self._folder.name, name)
        self.port = str(self._link)
        self._lock = threading.RLock()
        self._due: deque[tuple[float, bytes]] = deque()
        self._free_s = self._sent_s = clock.now_s()
        self._received = b""
        self._ends: tuple[int, int] | None = None
        self._woken, self._wake = os.pipe()
        self.plug()
        self._thread = in_background(self._run)

    def unplug(self) -> None:
        """Pull the cable: the port goes, and with it whatever was under way."""
        with self._lock:
            ends, self._ends = self._ends, None
            self._due.clear()
            self._link.unlink(missing_ok=True)
            for end in ends or ():
                os.close(end)
        os.write(self._wake, b"!")

    def plug(self) -> None:
        """Put the cable in: another terminal, at the same link."""
        with self._lock:
            if self._ends is None:
                self._ends = os.openpty()
                tty.setraw(self._ends[1])
                os.set_blocking(self._ends[0], False)
                self._stopped = False
                self._link.symlink_to(os.ttyname(self._ends[1]))
        os.write(self._wake, b"!")

    def close(self) -> None:
        """Take it away; it does not come back."""
        self._ended = True
        self.unplug()
        self._thread.result()
        os.close(self._woken)
        os.close(self._wake)
        self._folder.cleanup()

    @abstractmethod
    def _respond(self, data: bytes) -> Iterable[Response]:
        """Its responses to ``data``, which is a part of a command, or several."""

    def _lines(self, data: bytes, ending: bytes) -> list[str]:
        """The lines that ``data`` completes."""
        *lines, self._received = (self._received + data).split(ending)
        return [line.decode("ascii", "replace").strip() for line in lines]

    def _run(self) -> None:
        while not self._ended:
            with self._lock:
                wait_s = self._send_due()
                ends = self._ends
            watched = [self._woken] if ends is None else [self._woken, ends[0]]
            try:
                ready = select.select(watched, [], [], wait_s)[0]
            except (OSError, ValueError):  # unplugged in this moment
                continue
            if self._woken in ready:
                os.read(self._woken, 64)
            with self._lock:
                if ends is not None and ends is self._ends and ends[0] in ready:
                    with contextlib.suppress(OSError):
                        self._take(os.read(ends[0], 4096))

    def _take(self, data: bytes) -> None:
        for byte in data:
            if byte in XON + XOFF:
                self._stopped = byte in XOFF
        received = data.translate(None, XON + XOFF)
        self._free_s = max(self._free_s, self._clock.now_s() + len(received) * self._byte_s)
        for duration_s, reply in self._respond(received):
            self._free_s += duration_s
            if reply:
                self._due.append((self._free_s, reply))

    def _send_due(self) -> float | None:
        """Send what should be there by now; the machine's seconds until there is more, None for ever."""
        while self._due and self._ends is not None and not self._stopped:
            now_s = self._clock.now_s()
            at_s, data = self._due.popleft()
            begin_s = max(at_s, self._sent_s)
            count = max(min(int((now_s - begin_s) / self._byte_s), len(data)), 0)
            if count:
                with contextlib.suppress(BlockingIOError):  # nobody reads: what does not fit is lost, as on a wire
                    os.write(self._ends[0], data[:count])
                self._sent_s = begin_s + count * self._byte_s
            if count < len(data):
                self._due.appendleft((at_s, data[count:]))
            if not count:
                return max(self._clock.wall_s(begin_s + self._byte_s - now_s), _SHORTEST_WAIT_S)
        return None
