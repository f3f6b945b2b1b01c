"""A Voetsch or Weiss climate chamber. Its protocol is ASCII-2: ``$``, an address, a letter, numbers in ``%06.1f``, CR.

A state is values, the first two the temperature's nominal and actual one, and outputs, counted from 0 on the left. A
VT 4004 has five such pairs and sixteen outputs: 1 starts the chamber, 3 its temperature controller; others have other
numbers of both, and start by output 1 alone. What a campaign does not give of the layout, by its numbers or by a model
of ``voetsch_chambers.yaml``, is asked with ``?``, or else taken from the first two states, which have to agree; from
then on no other is taken for a state. The reply to a malformed command is silence, an empty line or some text, and no
fault is taken to be number 00.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import Field, NonNegativeFloat, model_validator

from ambient_trainer.data.strict_yaml import load_yaml, wrong
from ambient_trainer.laboratory import serial_line
from ambient_trainer.laboratory.instruments import AIR, RUNNING, SET_POINT, ChamberLimits, ChamberSettings
from ambient_trainer.laboratory.messages import Clock, InstrumentError, NoResponse, Reading
from ambient_trainer.laboratory.pseudo_terminal import Response, SimulatedInstrument
from ambient_trainer.laboratory.serial_line import Answer, Malformed, Query, SerialDriver, SerialLine

if TYPE_CHECKING:
    import numpy as np

START = 1
"""The output that lets the chamber run."""
VALUES, OUTPUTS = 5, 16
"""Of a VT 4004."""

_BAUD = 9600
_LONGEST = 400
_NUMBER = r"(?:\d{4}|-\d{3})\.\d"
_FIELDS = re.compile(r"((?:\s[A-Z]V\d\d)+)((?:\s+DO\d\d)+)")
_STATE = re.compile(rf"({_NUMBER}(?: {_NUMBER})+) ([01]{{8,}})[A-Z]?")
_FAULT = re.compile(r"(\d\d)(?: +(.*))?")
MODELS: dict[str, dict[str, Any]] = load_yaml(str(Path(__file__).with_name("voetsch_chambers.yaml")))
"""By its name what is known of a chamber: keys of the settings."""


class Settings(ChamberSettings):
    """The chamber; a ``model`` of :data:`MODELS` gives what stands here.

    ``pause_s`` is the least time between two strings: a later controller needs 5 s. ``values`` is how many nominal
    values are set at once, ``other_values`` what all but the first are then (else: as last reported, in pairs with the
    actual ones), ``outputs`` how many there are, and ``start`` those that are on while it runs.
    ``gradient`` is the form of the gradients' command: ``both`` ways in one, the one way that is ``needed`` and 0 for
    the other, or both and the ``outputs``. With ``alarms: false`` it is not asked for faults, which some chambers do
    not know: then it is not noticed where one stops it. ``marker`` is then another command that changes nothing and is
    answered by text, such as ``?``; with it, answers that are one behind are noticed.
    """

    kind: Literal["voetsch-vt4004"]
    model: str | None = None
    address: Annotated[int, Field(ge=0, le=99)] = 0
    terminator: Literal["CR", "CRLF"] = "CR"
    pause_s: NonNegativeFloat = 0.0
    lowest_degC: float = -45.0
    highest_degC: float = 185.0
    values: Annotated[int, Field(ge=1, le=20)] | None = None
    other_values: tuple[float, ...] | None = None
    outputs: Annotated[int, Field(ge=8, le=64)] | None = None
    start: tuple[Annotated[int, Field(ge=0, lt=64)], ...] | None = None
    gradient: Literal["both", "needed", "outputs"] = "both"
    alarms: bool = True
    marker: Annotated[str, Field(pattern=r"^[A-DF-HJ-TV-Z?]$")] | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_its_model(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(model := data.get("model"), str):
            return data
        if model not in MODELS:
            raise wrong(f"no model is called {model!r}", f"known are {', '.join(MODELS)}; or give its keys instead")
        return {**MODELS[model], **data}

    def _wrong(self) -> Iterator[tuple[str, str]]:
        values = self.values or 1 + len(self.other_values or ())
        if self.other_values is not None and len(self.other_values) != values - 1:
            yield f"{len(self.other_values)} of other_values", f"give all but the first of the {values} values"


class State(NamedTuple):
    """The reply to ``I``: values, of which the first two are the temperature's nominal and actual degC, and outputs."""

    values: tuple[float, ...]
    outputs: tuple[bool, ...]


class Layout(NamedTuple):
    """The place in a state of each nominal value, and how many values and outputs a state has."""

    nominal: tuple[int, ...]
    readings: int
    outputs: int


def layout_in(text: str) -> Layout | None:
    """The layout that the reply to ``?`` describes, None where it does not.

    It names the fields of the command ``E``, then those of a state, as in ``CV01 CV01 CV02 CV02 SV01 DO00 DO01``.
    """
    strings = [(fields[1].split(), re.findall(r"DO(\d\d)", fields[2])) for fields in _FIELDS.finditer(text)]
    if len(strings) < 2 or not set(strings[0][0]) <= set(read := strings[1][0]):
        return None
    return Layout(tuple(map(read.index, strings[0][0])), len(read), 1 + int(max(strings[1][1])))


class Fault(NamedTuple):
    """The reply to ``F``; number 0 is no fault."""

    number: int
    text: str

    def __str__(self) -> str:
        return f"{self.number:02d} {self.text}".rstrip()


DONE = "0"
"""The reply to a command that was taken; as of any other line, its text."""
Reply = State | Fault | str


def _parsed(line: str) -> Reply | Malformed:
    if not line:
        return Malformed("an empty line, as after a malformed command")
    if match := _STATE.fullmatch(line):
        return State(tuple(map(float, match[1].split(" "))), tuple(bit == "1" for bit in match[2]))
    if match := _FAULT.fullmatch(line):
        return Fault(int(match[1]), (match[2] or "").strip())
    return line


decode = serial_line.text_replies(b"\r", b"\n", _LONGEST, _parsed)
"""From the bytes that a chamber sends to its replies."""


def _numbers(values: Sequence[float]) -> bytes:
    texts = [f"{value:06.1f}" for value in values]
    assert all(len(text) == 6 for text in texts), f"{texts} do not fit the protocol's six characters"
    return " ".join(texts).encode("ascii")


def _bits(outputs: Sequence[bool]) -> bytes:
    return b"".join(b"1" if output else b"0" for output in outputs)


class Driver(SerialDriver):
    """The chamber on its line; a set point or a stop is sent even where it does not answer."""

    def __init__(self, settings: Settings, clock: Clock, limits: ChamberLimits) -> None:
        self._settings, self._limits = settings, limits
        self._layout: Layout | None = None
        self._last: State | None = None
        self._read_state = Query(self._command(b"I"), "a state, values and outputs", self._is_state)
        fault = "a fault, two digits and text"
        self._read_fault = Query(self._command(b"F"), fault, lambda reply: isinstance(reply, Fault))
        faults = ", and does it know 'F' (else 'alarms: false')" if settings.alarms else ""
        hint = f"{NoResponse.hint} is its address {settings.address}{faults}?"
        marker = self._read_fault if settings.alarms else self._read_state
        quiet_s = serial_line.QUIET_S if settings.alarms else settings.timeout_s
        self.line = SerialLine("chamber", settings, clock, decode, marker, _BAUD, quiet_s=quiet_s, silent_hint=hint)

    def identify(self) -> str:
        """The chamber's state: the protocol has no name."""
        values = self.read().values
        return f"ASCII-2 chamber, {'running' if values[RUNNING] else 'stopped'}, at {values[AIR]:.1f} degC"

    def read(self) -> Reading:
        asked_s, answered_s, state = self._state()
        alarm = None
        if self._settings.alarms:
            fault = self.line.query(self._read_fault).reply
            alarm = str(fault) if fault.number else None
        elif self._settings.marker:
            text = self.line.text(self._command(self._settings.marker.encode()))
            if not text or any(isinstance(reply, State) or reply == DONE for reply in decode(text)[0]):
                raise self.line.failed("text that answers the marker", serial_line.shown(text))
        values = {SET_POINT: state.values[0], AIR: state.values[1], RUNNING: float(state.outputs[START])}
        return Reading(asked_s, answered_s, values, alarm)

    def set_point(self, temp_degC: float) -> None:
        allowed_degC = self._limits.set_point(temp_degC)
        self._set(allowed_degC, True, f"'0' to the set point {allowed_degC:.1f} degC")

    def gradient(self, rate_K_min: float, rising: bool = True) -> None:
        up_K_min = down_K_min = self._limits.gradient(rate_K_min)
        if self._settings.gradient == "needed":
            up_K_min, down_K_min = (up_K_min, 0.0) if rising else (0.0, down_K_min)
        # the second pair is a humidity's, which a chamber without it ignores; some have the outputs in its place
        further = _bits(self._outputs(True)) if self._settings.gradient == "outputs" else _numbers((0.0, 0.0))
        expected = f"'0' to the gradient {up_K_min:.1f} K/min up, {down_K_min:.1f} K/min down"
        self.line.query(self._order(b"U %s %s" % (_numbers((up_K_min, down_K_min)), further), expected))

    def stop(self) -> None:
        default_degC = min(max(20.0, self._limits.low_degC), self._limits.high_degC)
        self._set(self._last.values[0] if self._last else default_degC, False, "'0' to the stop")

    def _command(self, text: bytes) -> bytes:
        return b"$%02d%s%s" % (self._settings.address, text, b"\r\n" if self._settings.terminator == "CRLF" else b"\r")

    def _order(self, text: bytes, expected: str) -> Query:
        return Query(self._command(text), expected, lambda reply: reply == DONE)

    def _is_state(self, reply: object) -> bool:
        """Whether it is a state of the chamber's layout, as far as that is known."""
        if not isinstance(reply, State):
            return False
        layout = self._layout or self._layout_like(reply)
        return (len(reply.values), len(reply.outputs)) == (layout.readings, layout.outputs)

    def _layout_like(self, state: State) -> Layout:
        """The layout by what the campaign gives, and else by a state."""
        given, readings = self._settings, len(state.values)
        if given.values and given.other_values is None:
            readings = 2 * given.values
        return Layout(tuple(range(0, readings, 2)), readings, given.outputs or len(state.outputs))

    def _state(self) -> Answer:
        known = self._layout
        try:
            if known is None:
                if not (self._settings.values or self._settings.outputs):
                    self._layout = layout_in(self.line.text(self._command(b"?")).decode("ascii", "replace"))
                self._layout = self._layout or self._layout_like(self.line.query(self._read_state).reply)
            answer = self.line.query(self._read_state)
        except InstrumentError:
            self._layout = known
            raise
        self._last = answer.reply
        return answer

    def _outputs(self, run: bool) -> list[bool]:
        outputs = list(self._last.outputs if self._last else (False,) * (self._settings.outputs or OUTPUTS))
        for output in self._settings.start or ((START, 3) if len(outputs) == OUTPUTS else (START,)):
            outputs[output] = run
        return outputs

    def _set(self, nominal_degC: float, run: bool, expected: str) -> None:
        """Set the temperature; other values and outputs stay as the chamber last reported them."""
        if self._last is None:
            with contextlib.suppress(InstrumentError):  # a VT 4004, then
                self._state()
        others = self._settings.other_values
        if others is None and self._last and self._layout:
            others = tuple(self._last.values[place] for place in self._layout.nominal[1:])
        elif others is None:
            others = (0.0,) * ((self._settings.values or VALUES) - 1)
        command = b"E %s %s" % (_numbers((nominal_degC, *others)), _bits(self._outputs(run)))
        self.line.query_anyway(self._order(command, expected))


_ANSWERS_AFTER_S = 0.08  # chosen
_SET = re.compile(r"E((?: -?\d+\.\d)+) ([01]+)")
_GRADIENT = re.compile(r"U (-?\d+\.\d) (-?\d+\.\d) .*")


class Simulated(SimulatedInstrument):
    """The chamber with the air inside it, stopped; during ``pause_s`` after a string it receives nothing."""

    def __init__(
        self, settings: Settings, clock: Clock, seed: int | np.random.Generator = 0, room_degC: float = 22.0
    ) -> None:
        from ambient_trainer.simulator.live import ChamberAir  # scipy: the watchdog does not wait for it

        self.air = ChamberAir(clock.now_s(), room_degC, seed)
        self.air_degC = self.air.at
        self._settings, self._receives_from_s = settings, -math.inf
        self._nominal: tuple[float, ...] = (room_degC, *(0.0,) * ((settings.values or VALUES) - 1))
        self._outputs: tuple[bool, ...] = (False,) * (settings.outputs or OUTPUTS)
        self._fault = Fault(0, "")
        super().__init__("chamber", clock, _BAUD)

    @property
    def held_degC(self) -> float | None:
        """The set point that it holds; None while it is stopped."""
        return self._nominal[0] if self._outputs[START] else None

    def put(self, nominal: tuple[float, ...], outputs: tuple[bool, ...]) -> None:
        """Set nominal values and outputs, as at the chamber's panel."""
        run = outputs[START] and not self._fault.number
        self._nominal, self._outputs = nominal, (*outputs[:START], run, *outputs[START + 1 :])
        self.air.drive(self._clock.now_s(), self.held_degC)

    def answer(self, command: str) -> bytes:
        """The reply to what stands behind ``$`` and the address."""
        if command == "I":
            actual_degC = round(self.air.at(self._clock.now_s()), 1) + 0.0
            values = [value for nominal in self._nominal for value in (nominal, actual_degC)]
            return b"%s %s\r" % (_numbers(values), _bits(self._outputs))
        if command == "F":
            return f"{self._fault}\r".encode("ascii")
        if match := _SET.fullmatch(command):
            nominal = tuple(float(number) for number in match[1].split())
            layout = (len(nominal), len(match[2])) == (len(self._nominal), len(self._outputs))
            if layout and self._settings.lowest_degC <= nominal[0] <= self._settings.highest_degC:
                self.put(nominal, tuple(bit == "1" for bit in match[2]))
                return b"0\r"
        if match := _GRADIENT.fullmatch(command):
            self.air.limit(self._clock.now_s(), float(match[1]), float(match[2]))
            return b"0\r"
        return b"\r"  # malformed; the manual leaves it open: this, or silence

    def _respond(self, data: bytes) -> Iterator[Response]:
        for text in self._lines(data, b"\r"):
            now_s = self._clock.now_s()
            if now_s < self._receives_from_s:
                continue
            self._receives_from_s = now_s + self._settings.pause_s
            if text.startswith(own := f"${self._settings.address:02d}"):
                yield Response(_ANSWERS_AFTER_S, self.answer(text.removeprefix(own)))
