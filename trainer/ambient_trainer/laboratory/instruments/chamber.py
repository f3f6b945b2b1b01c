"""The climate chamber: no set point outside its limits ever leaves this module."""

from __future__ import annotations

from ambient_model.faults import Refused, refuse
from ambient_trainer.laboratory.clock import Clock, RealClock
from ambient_trainer.laboratory.instruments.readings import ChamberReading
from ambient_trainer.laboratory.line import Line, Question
from ambient_trainer.laboratory.protocols import voetsch

LOWEST_DEGC, HIGHEST_DEGC = -45.0, 185.0
"""What the chamber itself can do."""
STEEPEST_K_MIN = 99.9
LATER_CONTROLLERS_PAUSE_S = 5.0
"""A later controller takes at most one string in this time."""

_BAUD = 9600
_STATE = Question(voetsch.STATE, "a state, five pairs of values", lambda reply: isinstance(reply, voetsch.State))
_FAULT = Question(voetsch.FAULT, "a fault, two digits and text", lambda reply: isinstance(reply, voetsch.FaultText))


class Chamber:
    """A Voetsch chamber on the serial line at ``port``."""

    def __init__(
        self,
        port: str,
        low_degC: float = -20.0,
        high_degC: float = 60.0,
        *,
        name: str = "chamber",
        clock: Clock | None = None,
        pause_s: float = 0.0,
        timeout_s: float = 2.0,
    ) -> None:
        if not LOWEST_DEGC <= low_degC < high_degC <= HIGHEST_DEGC:
            raise refuse(
                name,
                "limits",
                f"{low_degC:g} to {high_degC:g} degC",
                f"name two, the lower first, within {LOWEST_DEGC:g} to {HIGHEST_DEGC:g} degC",
            )
        self.name = name
        self.port = port
        self.low_degC = low_degC
        self.high_degC = high_degC
        self._line: Line[voetsch.Reply] = Line(
            name, port, _BAUD, voetsch.Decoder, _FAULT, clock or RealClock(), timeout_s, pause_s
        )
        self._last: voetsch.State | None = None

    def identify(self) -> str:
        """What is at the port; the protocol knows no name, so its state must do."""
        reading = self.read()
        doing = "running" if reading.running else "stopped"
        return f"ASCII-2 chamber, {doing}, at {reading.actual_degC:.1f} degC"

    def read(self) -> ChamberReading:
        """Set point, temperature, and whether something is wrong; raises :class:`LineError`."""
        asked_s, answered_s, state = self._line.ask(_STATE)
        assert isinstance(state, voetsch.State)
        self._last = state
        fault = self._line.ask(_FAULT).reply
        assert isinstance(fault, voetsch.FaultText)
        alarm = f"{fault.number:02d} {fault.text}".rstrip() if fault.number else None
        return ChamberReading(
            asked_s, answered_s, state.nominal[0], state.actual[0], state.outputs[voetsch.START], alarm
        )

    def set_point(self, temp_degC: float) -> None:
        """Go to ``temp_degC`` (in tenths), and start; raises Refused outside the limits, LineError where it fails.

        It is sent even where the chamber does not answer: its ears may be better than its voice.
        """
        rounded_degC = self._allowed(temp_degC)
        self._command(rounded_degC, True, f"'0' to the set point {rounded_degC:.1f} degC")

    def gradient(self, up_K_min: float, down_K_min: float) -> None:
        """Let the set point rise and fall no faster than this, in tenths of K/min; 0.0 does not limit it."""
        rates = [self._rate(up_K_min, "up"), self._rate(down_K_min, "down")]
        expected = f"'0' to the gradient {rates[0]:.1f} K/min up, {rates[1]:.1f} K/min down"
        self._line.ask(Question(voetsch.set_gradients(*rates), expected, _is_done))

    def stop(self) -> None:
        """Stop heating and cooling; sent even where the chamber does not answer."""
        nominal_degC = self._last.nominal[0] if self._last else min(max(20.0, self.low_degC), self.high_degC)
        self._command(nominal_degC, False, "'0' to the stop")

    def acknowledge(self) -> None:
        """Acknowledge a fault; what still is wrong comes back."""
        self._line.ask(Question(voetsch.ACKNOWLEDGE, "'0' to the acknowledgement", _is_done))

    def close(self) -> None:
        """Give the port back."""
        self._line.close()

    def _command(self, nominal_degC: float, run: bool, expected: str) -> None:
        """Set the temperature; other values and outputs stay as the chamber last told them."""
        others = self._last.nominal[1:] if self._last else (0.0,) * (voetsch.VALUES - 1)
        outputs = list(self._last.outputs if self._last else (False,) * voetsch.OUTPUTS)
        outputs[voetsch.START] = outputs[voetsch.TEMPERATURE] = run
        request = voetsch.set_values((nominal_degC, *others), outputs)
        self._line.insist(Question(request, expected, _is_done))

    def _allowed(self, temp_degC: float) -> float:
        """``temp_degC`` as the protocol can say it."""
        rounded_degC = round(temp_degC, 1) + 0.0  # no -0.0
        if not self.low_degC <= min(temp_degC, rounded_degC) <= max(temp_degC, rounded_degC) <= self.high_degC:
            raise self._refused(
                "set point",
                f"{temp_degC:g} degC is outside its limits, {self.low_degC:g} to {self.high_degC:g} degC",
                "choose another, or other limits; nothing was sent",
            )
        return rounded_degC

    def _rate(self, rate_K_min: float, way: str) -> float:
        rounded_K_min = round(rate_K_min, 1)
        if not 0.0 <= rate_K_min <= STEEPEST_K_MIN or (rounded_K_min == 0.0 and rate_K_min > 0.0):
            raise self._refused(
                f"gradient {way}",
                f"{rate_K_min:g} K/min",
                f"choose 0.1 to {STEEPEST_K_MIN:g} K/min, or 0 for none; nothing was sent",
            )
        return rounded_K_min

    def _refused(self, place: str, problem: str, mend: str) -> Refused:
        return refuse(f"{self.name} on {self.port}", place, problem, mend)


def _is_done(reply: object) -> bool:
    return isinstance(reply, voetsch.Done)
