"""A Voetsch VT 4004 climate chamber. Its protocol is ASCII-2: ``$00``, a letter, numbers in ``%06.1f``, CR.

Five pairs of nominal and actual values, the first being the temperature, and sixteen outputs, counted from 0 on the
left: 1 starts the chamber, 3 its temperature controller. A nominal value counts only with its output. What the manual
leaves open: the reply to a malformed command is silence or an empty line, and no fault is taken to be number 00.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

from ambient_trainer.laboratory.instruments import AIR, RUNNING, SET_POINT, ChamberSettings, NotNegative
from ambient_trainer.laboratory.messages import Clock, Reading
from ambient_trainer.laboratory.pseudo_terminal import Response, SimulatedInstrument
from ambient_trainer.laboratory.serial_line import Malformed, Query, SerialDriver, SerialLine, text_replies
from ambient_trainer.laboratory.set_point_limits import SetPointLimits

if TYPE_CHECKING:
    import numpy as np

LOWEST_DEGC, HIGHEST_DEGC = -45.0, 185.0
"""What the chamber itself can do."""
START, TEMPERATURE = 1, 3
"""The outputs that let the chamber run, and let the first nominal value count."""
VALUES, OUTPUTS = 5, 16

_BAUD = 9600
_LONGEST = 200
_NUMBER = r"(?:\d{4}|-\d{3})\.\d"
_STATE = re.compile(rf"{_NUMBER}(?: {_NUMBER}){{{2 * VALUES - 1}}} [01]{{{OUTPUTS}}}")
_FAULT = re.compile(r"(\d\d)(?: +(.*))?")
_A_REPLY = "five pairs of values and 16 outputs, '0', or a fault's two digits and text"


class Settings(ChamberSettings):
    """The chamber; ``pause_s`` is the least time between two strings: a later controller needs 5 s."""

    kind: Literal["voetsch-vt4004"]
    pause_s: NotNegative = 0.0


class State(NamedTuple):
    """The reply to ``$00I``: nominal and actual values, the temperature's in degC first, and the outputs."""

    nominal: tuple[float, ...]
    actual: tuple[float, ...]
    outputs: tuple[bool, ...]


class Done(NamedTuple):
    """``0``: the command was taken."""


class Fault(NamedTuple):
    """The reply to ``$00F``; number 0 is no fault."""

    number: int
    text: str


READ_STATE = Query(b"$00I\r", "a state, five pairs of values", lambda reply: isinstance(reply, State))
READ_FAULT = Query(b"$00F\r", "a fault, two digits and text", lambda reply: isinstance(reply, Fault))


def set_values(nominal: Sequence[float], outputs: Sequence[bool]) -> bytes:
    """The command that sets five nominal values and sixteen outputs."""
    return b"$00E %s %s\r" % (_numbers(nominal), _bits(outputs))


def set_gradients(up_K_min: float, down_K_min: float) -> bytes:
    """The command that limits how fast the nominal temperature rises and falls; 0.0 does not limit it.

    The second pair is a humidity's, which a chamber without it ignores.
    """
    return b"$00U %s\r" % _numbers((up_K_min, down_K_min, 0.0, 0.0))


Reply = State | Done | Fault


def _parsed(line: str) -> Reply | Malformed:
    if not line:
        return Malformed(_A_REPLY, "an empty line, as after a malformed command")
    if line == "0":
        return Done()
    if _STATE.fullmatch(line):
        *numbers, bits = line.split(" ")
        values = [float(number) for number in numbers]
        return State(tuple(values[::2]), tuple(values[1::2]), tuple(bit == "1" for bit in bits))
    if match := _FAULT.fullmatch(line):
        return Fault(int(match[1]), (match[2] or "").strip())
    return Malformed(_A_REPLY, repr(line))


decode = text_replies(b"\r", b"\n", _LONGEST, _parsed)
"""From the bytes that a chamber sends to its replies."""


def encode(reply: Reply) -> bytes:
    """The bytes of a reply."""
    if isinstance(reply, State):
        pairs = [value for pair in zip(reply.nominal, reply.actual) for value in pair]
        return b"%s %s\r" % (_numbers(pairs), _bits(reply.outputs))
    return b"0\r" if isinstance(reply, Done) else f"{reply.number:02d} {reply.text}".rstrip().encode("ascii") + b"\r"


def _numbers(values: Sequence[float]) -> bytes:
    texts = [f"{value:06.1f}" for value in values]
    assert all(len(text) == 6 for text in texts), f"{texts} do not fit the protocol's six characters"
    return " ".join(texts).encode("ascii")


def _bits(outputs: Sequence[bool]) -> bytes:
    return b"".join(b"1" if output else b"0" for output in outputs)


class Driver(SerialDriver):
    """The chamber on its serial line; a set point or a stop is sent even where it does not answer."""

    def __init__(self, settings: Settings, clock: Clock, limits: SetPointLimits) -> None:
        self._limits = limits.within(LOWEST_DEGC, HIGHEST_DEGC)
        self.line = SerialLine("chamber", settings, clock, decode, READ_FAULT, baud=_BAUD, pause_s=settings.pause_s)
        self._last: State | None = None

    def identify(self) -> str:
        """The chamber's state: the protocol has no name."""
        values = self.read().values
        return f"ASCII-2 chamber, {'running' if values[RUNNING] else 'stopped'}, at {values[AIR]:.1f} degC"

    def read(self) -> Reading:
        """Set point, temperature and whether it runs; its fault is the note."""
        asked_s, answered_s, state = self.line.query(READ_STATE)
        self._last = state
        fault = self.line.query(READ_FAULT).reply
        alarm = f"{fault.number:02d} {fault.text}".rstrip() if fault.number else None
        values = {SET_POINT: state.nominal[0], AIR: state.actual[0], RUNNING: float(state.outputs[START])}
        return Reading(asked_s, answered_s, values, alarm)

    def set_point(self, temp_degC: float) -> None:
        """Go to ``temp_degC`` and start."""
        allowed_degC = self._limits.set_point(temp_degC)
        self._command(allowed_degC, True, f"'0' to the set point {allowed_degC:.1f} degC")

    def gradient(self, rate_K_min: float) -> None:
        """Let the set point rise and fall no faster than this; 0 does not limit it."""
        allowed_K_min = self._limits.gradient(rate_K_min)
        expected = f"'0' to the gradient {allowed_K_min:.1f} K/min up, {allowed_K_min:.1f} K/min down"
        self.line.query(Query(set_gradients(allowed_K_min, allowed_K_min), expected, _is_done))

    def stop(self) -> None:
        """Stop heating and cooling."""
        low_degC, high_degC = self._limits.low_degC, self._limits.high_degC
        nominal_degC = self._last.nominal[0] if self._last else min(max(20.0, low_degC), high_degC)
        self._command(nominal_degC, False, "'0' to the stop")

    def _command(self, nominal_degC: float, run: bool, expected: str) -> None:
        """Set the temperature; other values and outputs stay as the chamber last reported them."""
        others = self._last.nominal[1:] if self._last else (0.0,) * (VALUES - 1)
        outputs = list(self._last.outputs if self._last else (False,) * OUTPUTS)
        outputs[START] = outputs[TEMPERATURE] = run
        self.line.query_anyway(Query(set_values((nominal_degC, *others), outputs), expected, _is_done))


def _is_done(reply: object) -> bool:
    return isinstance(reply, Done)


_ANSWERS_AFTER_S = 0.08  # chosen
_SET = re.compile(rf"E((?: -?\d+\.\d){{{VALUES}}}) ([01]{{{OUTPUTS}}})")
_GRADIENT = re.compile(r"U (-?\d+\.\d) (-?\d+\.\d)(?: -?\d+\.\d)*")


class Simulated(SimulatedInstrument):
    """The chamber with the air inside it, stopped; during ``pause_s`` after a string it receives nothing."""

    def __init__(
        self,
        settings: Settings,
        clock: Clock,
        seed: int | np.random.Generator = 0,
        room_degC: float = 22.0,
        folder: str | None = None,
    ) -> None:
        from ambient_trainer.laboratory.chamber_air import ChamberAir  # scipy: the watchdog does not wait for it

        self.air = ChamberAir(clock.now_s(), room_degC, seed)
        self._pause_s = settings.pause_s
        self._receives_from_s = -math.inf
        self._received = b""
        self._nominal: tuple[float, ...] = (room_degC, 0.0, 0.0, 0.0, 0.0)
        self._outputs: tuple[bool, ...] = (False,) * OUTPUTS
        self._fault = Fault(0, "")
        self._broken = False
        super().__init__("chamber", clock, _BAUD, folder)

    def air_degC(self, at_s: float | None = None) -> float:
        """The true air, now or at a time of the clock since the start."""
        return self.air.at(self._clock.now_s() if at_s is None else at_s)

    @property
    def held_degC(self) -> float | None:
        """The set point that it holds; None while it is stopped."""
        return self._nominal[0] if self._outputs[START] and self._outputs[TEMPERATURE] else None

    def raise_alarm(self, number: int, text: str) -> None:
        """Break something: the chamber stops, and starts only when that is repaired and acknowledged."""
        with self._lock:
            self._fault, self._broken = Fault(number, text), True
            self.put(self._nominal, self._outputs)

    def repair(self) -> None:
        """Repair what broke; its fault is still to be acknowledged."""
        self._broken = False

    def put(self, nominal: tuple[float, ...], outputs: tuple[bool, ...]) -> None:
        """Set nominal values and outputs, as at the chamber's panel."""
        run = outputs[START] and not self._fault.number
        self._nominal = nominal
        self._outputs = (*outputs[:START], run, *outputs[START + 1 :])
        self.air.drive(self._clock.now_s(), self.held_degC)

    def answer(self, command: str) -> bytes:
        """The reply to what stands behind ``$00``."""
        if command == "I":
            actual_degC = round(self.air_degC(), 1) + 0.0
            return encode(State(self._nominal, (actual_degC,) * VALUES, self._outputs))
        if command == "F":
            return encode(self._fault)
        if command == "Q":  # acknowledges the fault
            self._fault = self._fault if self._broken else Fault(0, "")
            return encode(Done())
        if match := _SET.fullmatch(command):
            nominal = tuple(float(number) for number in match[1].split())
            if LOWEST_DEGC <= nominal[0] <= HIGHEST_DEGC:
                self.put(nominal, tuple(bit == "1" for bit in match[2]))
                return encode(Done())
        if match := _GRADIENT.fullmatch(command):
            self.air.limit(self._clock.now_s(), float(match[1]), float(match[2]))
            return encode(Done())
        return b"\r"  # malformed; the manual leaves it open: this, or silence

    def _respond(self, data: bytes) -> Iterator[Response]:
        *lines, self._received = (self._received + data).split(b"\r")
        for line in lines:
            now_s = self._clock.now_s()
            if now_s < self._receives_from_s:
                continue
            self._receives_from_s = now_s + self._pause_s
            text = line.strip(b"\n").decode("ascii", "replace")
            if text.startswith("$00"):
                yield Response(_ANSWERS_AFTER_S, self.answer(text.removeprefix("$00")))
