"""What an instrument answers: a reading with its times, or an error that names instrument, port, expected and got."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Reading(NamedTuple):
    """One answer: values by column (None for none), and when, in the clock's seconds.

    The note is what else the instrument reports, such as an alarm, or why it has no value.
    """

    asked_s: float
    answered_s: float
    values: Mapping[str, float | None]
    note: str | None = None


class InstrumentError(Exception):
    """An exchange with an instrument that failed; the next one may succeed."""

    hint = "is it the instrument that belongs on this port, and does no other program use it?"

    def __init__(self, instrument: str, port: str, expected: str, got: str, hint: str | None = None) -> None:
        self.instrument, self.port, self.expected, self.got = instrument, port, expected, got
        self.hint = hint or self.hint
        super().__init__(instrument, port, expected, got)

    def __str__(self) -> str:
        return f"{self.instrument} on {self.port}: expected {self.expected}, got {self.got}; {self.hint}"


class Disconnected(InstrumentError):
    """The port is not there, is in use by another, or went while it was in use."""

    hint = "plug it in, or correct the port; it is opened again by itself"


class NoResponse(InstrumentError):
    """Nothing came in time."""

    hint = "is it switched on, and is this its port and its speed?"
