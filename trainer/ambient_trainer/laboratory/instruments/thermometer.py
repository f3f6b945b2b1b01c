"""The reference thermometer: it switches itself off, and without a sensor it says so instead of a number."""

from __future__ import annotations

from ambient_trainer.laboratory.clock import Clock, RealClock
from ambient_trainer.laboratory.instruments.readings import ThermometerReading
from ambient_trainer.laboratory.line import Answer, Line, LineError, Question, Silent, SwitchedOff
from ambient_trainer.laboratory.protocols import easybus
from ambient_trainer.laboratory.protocols.misread import Misread

_BAUD = 4800


class Thermometer:
    """A Greisinger GMH thermometer on the serial line at ``port``."""

    def __init__(
        self,
        port: str,
        *,
        address: int = 1,
        name: str = "thermometer",
        clock: Clock | None = None,
        timeout_s: float = 1.0,
    ) -> None:
        self.name = name
        self.port = port
        self._value = _question(address, easybus.VALUE, "its value")
        self._identity = _question(address, easybus.IDENTITY, "its number")
        self._line: Line[easybus.Frame] = Line(
            name, port, _BAUD, easybus.Decoder, self._identity, clock or RealClock(), timeout_s
        )

    def identify(self) -> str:
        """The number that stands on it; raises :class:`LineError`."""
        return f"GMH thermometer, number {easybus.number_of(self._ask(self._identity).reply.body):x}"

    def read(self) -> ThermometerReading:
        """The temperature, or why there is none; raises :class:`LineError`, ``SwitchedOff`` where nothing comes."""
        asked_s, answered_s, frame = self._ask(self._value)
        value = easybus.value_of(frame.body)
        if isinstance(value, Misread):
            raise LineError(self.name, self.port, value.expected, value.got)
        return ThermometerReading(asked_s, answered_s, value.value, value.reason)

    def close(self) -> None:
        """Give the port back."""
        self._line.close()

    def _ask(self, question: Question) -> Answer[easybus.Frame]:
        try:
            return self._line.ask(question)
        except Silent as silent:
            raise SwitchedOff(silent.instrument, silent.port, silent.expected, silent.got) from silent


def _question(address: int, code: int, what: str) -> Question:
    return Question(
        easybus.request(address, code),
        f"{what}, a reply of address {address} to code {code}",
        lambda frame: isinstance(frame, easybus.Frame) and (frame.address, frame.code) == (address, code),
    )
