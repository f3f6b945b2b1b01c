"""What goes wrong on an instrument's line names the instrument, the port, what was expected and what came."""

from __future__ import annotations


class LineError(Exception):
    """An exchange with an instrument that failed; the next one may succeed."""

    def __init__(self, instrument: str, port: str, expected: str, got: str) -> None:
        self.instrument = instrument
        self.port = port
        self.expected = expected
        self.got = got
        super().__init__(instrument, port, expected, got)

    def __str__(self) -> str:
        return f"{self.instrument} on {self.port}: expected {self.expected}, got {self.got}"


class Unplugged(LineError):
    """The port is not there, is another's, or went while it was in use."""


class Silent(LineError):
    """No answer in time, or only a part of one."""


class SwitchedOff(Silent):
    """Silence of an instrument that switches itself off: somebody has to press its key."""
