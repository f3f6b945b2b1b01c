"""ASCII-2, what a Voetsch chamber speaks: ``$00``, a letter, numbers in ``%06.1f``; a carriage return ends a line.

Five pairs of nominal and actual values, the first being the temperature, and sixteen outputs, counted from 0 on the
left: 1 starts the chamber, 3 its temperature controller. A nominal value counts only with its output. What the manual
leaves open: the reply to a malformed command is silence or an empty line, and no fault is taken to be number 00.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from ambient_trainer.laboratory.protocols.lines import LineDecoder
from ambient_trainer.laboratory.protocols.misread import Misread

STATE = b"$00I\r"
FAULT = b"$00F\r"
ACKNOWLEDGE = b"$00Q\r"
START = 1
"""The output that lets the chamber run."""
TEMPERATURE = 3
"""The output that lets the first nominal value count."""
VALUES = 5
OUTPUTS = 16

_LONGEST = 200
_NUMBER = r"(?:\d{4}|-\d{3})\.\d"
_STATE = re.compile(rf"{_NUMBER}(?: {_NUMBER}){{{2 * VALUES - 1}}} [01]{{{OUTPUTS}}}")
_FAULT = re.compile(r"(\d\d)(?: +(.*))?")
_A_REPLY = "five pairs of values and 16 outputs, '0', or a fault's two digits and text"


class State(NamedTuple):
    """The reply to :data:`STATE`."""

    nominal: tuple[float, ...]
    """Shape (5,); the first is the temperature's, in degC."""
    actual: tuple[float, ...]
    outputs: tuple[bool, ...]
    """Shape (16,)."""


class Done(NamedTuple):
    """``0``: the command was taken."""


class FaultText(NamedTuple):
    """The reply to :data:`FAULT`."""

    number: int
    text: str


Reply = State | Done | FaultText


def set_values(nominal: Sequence[float], outputs: Sequence[bool]) -> bytes:
    """The command that sets five nominal values and sixteen outputs."""
    assert len(nominal) == VALUES, "the chamber has five nominal values"
    assert len(outputs) == OUTPUTS, "the chamber has sixteen outputs"
    return b"$00E %s %s\r" % (_numbers(nominal), _bits(outputs))


def set_gradients(up_K_min: float, down_K_min: float) -> bytes:
    """The command that limits how fast the nominal temperature rises and falls; 0.0 does not limit it.

    The second pair is a humidity's, which a chamber without it ignores.
    """
    return b"$00U %s\r" % _numbers((up_K_min, down_K_min, 0.0, 0.0))


def state_line(state: State) -> bytes:
    """The reply that says ``state``."""
    pairs = [value for pair in zip(state.nominal, state.actual) for value in pair]
    return b"%s %s\r" % (_numbers(pairs), _bits(state.outputs))


def fault_line(fault: FaultText) -> bytes:
    """The reply that says ``fault``."""
    return f"{fault.number:02d} {fault.text}".rstrip().encode("ascii") + b"\r"


DONE_LINE = b"0\r"


class Decoder(LineDecoder[Reply]):
    """What a chamber sends, in pieces of any size, to replies."""

    def __init__(self) -> None:
        super().__init__(b"\r", b"\n", _LONGEST, _reply)


def _reply(line: str) -> Reply | Misread:
    if not line:
        return Misread(_A_REPLY, "an empty line, as after a malformed command")
    if line == "0":
        return Done()
    if _STATE.fullmatch(line):
        *numbers, bits = line.split(" ")
        values = [float(number) for number in numbers]
        return State(tuple(values[::2]), tuple(values[1::2]), tuple(bit == "1" for bit in bits))
    if match := _FAULT.fullmatch(line):
        return FaultText(int(match[1]), (match[2] or "").strip())
    return Misread(_A_REPLY, repr(line))


def _numbers(values: Sequence[float]) -> bytes:
    texts = [f"{value:06.1f}" for value in values]
    assert all(len(text) == 6 for text in texts), f"{texts} do not fit the protocol's six characters"
    return " ".join(texts).encode("ascii")


def _bits(outputs: Sequence[bool]) -> bytes:
    return b"".join(b"1" if output else b"0" for output in outputs)
