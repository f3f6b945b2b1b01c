"""Breaks simulated instruments and the simulated phone as real ones break: nothing in the product asks for that."""

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from ambient_trainer.laboratory.instruments.voetsch_vt4004 import Fault
from ambient_trainer.laboratory.pseudo_terminal import Response


class _Spoiled:
    """Stands in the place of an instrument's responses."""

    def __init__(self, simulated: Any) -> None:
        self.respond, self.muted = simulated._respond, False
        self.changes: deque[tuple[Callable[[bytes], bytes], float]] = deque()

    def __call__(self, data: bytes) -> Iterator[Response]:
        for duration_s, reply in self.respond(data):
            change, late_s = self.changes.popleft() if reply and self.changes and not self.muted else (bytes, 0.0)
            yield Response(duration_s + late_s, b"" if self.muted else change(reply))


def _spoiled(simulated: Any) -> _Spoiled:
    if not isinstance(simulated._respond, _Spoiled):
        simulated._respond = _Spoiled(simulated)
    return simulated._respond


def mute(simulated: Any, muted: bool = True) -> None:
    """Let an instrument obey, and not answer."""
    _spoiled(simulated).muted = muted


def distort(simulated: Any, change: Callable[[bytes], bytes], late_s: float = 0.0) -> None:
    """Let its next reply be what is made of it, and come later."""
    _spoiled(simulated).changes.append((change, late_s))


def send(simulated: Any, data: bytes) -> None:
    """Send ``data`` unasked, at once."""
    with simulated._lock:
        simulated._due.appendleft((simulated._clock.now_s(), data))
    os.write(simulated._wake, b"!")


def raise_alarm(chamber: Any, number: int, text: str) -> None:
    """Stop the chamber; it starts only when the alarm is acknowledged."""
    with chamber._lock:
        chamber._fault = Fault(number, text)
        chamber.put(chamber._nominal, chamber._outputs)


def acknowledge(chamber: Any) -> None:
    """Take the alarm away, as at the chamber's panel."""
    chamber._fault = Fault(0, "")


def open_probe(probe: Any) -> None:
    """Break the wire of a thermocouple."""
    probe.read = lambda at_s: None


def pull_cable(phone: Any) -> None:
    """End the shells on the phone; no other can be had."""
    with contextlib.suppress(FileNotFoundError):
        (phone._here / "cable").unlink()
    phone._end_shells()
