"""EASYBus, what a Greisinger GMH thermometer speaks: groups of two bytes and a check, the first byte inverted.

A request is ``[~address, code << 4, check]``. A reply's first group is ``[~address, code << 4 | flags, check]``: bit 0
of the flags marks a reply, bits 1 and 2 count the groups that follow, bit 3 tells of a fault. Nothing ends a frame, so
a decoder looks for groups whose check is right, and moves on by one byte where one is not. The 32 bits of a value of
two groups, their first bytes inverted back: five bits of decimals plus 15, then 27 of digits less 2^25 (modulo 2^27),
or of a fault's number above 0x07F5E100. Of one group: two bits of decimals, 14 of digits plus 2048, faults from 0x3FE0.
(Schnittstellenbeschreibung fuer EASYBus-Sensormodule und GMH-Handmessgeraete, sections 8.1 and 8.5.)
"""

from __future__ import annotations

from typing import NamedTuple

from ambient_trainer.laboratory.protocols.misread import Misread, shown

VALUE = 0
"""The code that asks for the measured value."""
IDENTITY = 12
"""The code that asks for the number that stands on the instrument, in hexadecimal."""

FAULTS = {
    16352: "above the measuring range",
    16353: "below the measuring range",
    16362: "calculation not possible",
    16363: "system error",
    16364: "battery empty",
    16365: "no sensor",
    16366: "EEPROM error",
    16367: "EEPROM checksum error",
    16371: "value invalid",
}
NO_SENSOR = 16365

_GROUP = 3
_MOST_DECIMALS = 7  # of the nine digits that 27 bits hold
_FAULTS_32 = 0x07F5E100
_FAULTS_16 = 0x3FE0


class Frame(NamedTuple):
    """One reply: whose, to which code, and its bytes without the checks."""

    address: int
    code: int
    body: bytes

    def __str__(self) -> str:
        return f"a reply of address {self.address} to code {self.code} ({self.body.hex(' ').upper()})"


class Value(NamedTuple):
    """A measured value, or the reason why there is none."""

    value: float | None
    reason: str | None


def check(first: int, second: int) -> int:
    """The third byte of a group."""
    rest = (first << 8) | second
    for _ in range(16):
        rest = (rest << 1) ^ 0x700 if rest & 0x8000 else rest << 1
    return ~(rest >> 8) & 0xFF


def request(address: int, code: int) -> bytes:
    """The question for ``code``, 0 to 15."""
    return _group(_inverted(address), code << 4)


def value_of(body: bytes) -> Value | Misread:
    """What the body of a reply to :data:`VALUE` says."""
    if len(body) == 4:
        number = int.from_bytes(_upright(body), "big")
        digits = number & 0x07FFFFFF
        if digits >= _FAULTS_32:
            return _fault(digits - _FAULTS_32)
        digits = (digits + 0x02000000) & 0x07FFFFFF
        if digits & 0x04000000:
            digits -= 0x08000000
        decimals = (number >> 27) - 15
        if not 0 <= decimals <= _MOST_DECIMALS:
            return Misread(f"a value of 0 to {_MOST_DECIMALS} decimals", f"{decimals} decimals")
        return Value(digits / 10.0**decimals, None)
    if len(body) == 2:
        number = int.from_bytes(_upright(body), "big")
        digits = number & 0x3FFF
        if digits >= _FAULTS_16:
            return _fault(digits)
        return Value((digits - 2048) / 10.0 ** (number >> 14), None)
    return Misread("a value of one group or two", f"{len(body) // 2} groups")


def number_of(body: bytes) -> int:
    """The whole number that the body of any other reply says."""
    return int.from_bytes(_upright(body), "big")


def reply(address: int, code: int, body: bytes, faulty: bool = False) -> bytes:
    """The frame of a reply; ``body`` is of an even number of bytes, as on the line but for the checks."""
    groups = [body[at : at + 2] for at in range(0, len(body), 2)]
    head = _group(_inverted(address), code << 4 | faulty << 3 | len(groups) << 1 | 1)
    return head + b"".join(_group(*group) for group in groups)


def body_of_value(value: float, decimals: int) -> bytes:
    """The body that says ``value``, rounded to so many decimals."""
    digits = (round(value * 10**decimals) - 0x02000000) & 0x07FFFFFF
    return body_of_number((decimals + 15) << 27 | digits)


def body_of_fault(number: int) -> bytes:
    """The body that says a fault, one of :data:`FAULTS`."""
    return body_of_number(17 << 27 | (_FAULTS_32 + number))


def body_of_number(number: int) -> bytes:
    """The body of two groups that says a whole number."""
    return _upright(number.to_bytes(4, "big"))


class Decoder:
    """What a thermometer sends, in pieces of any size, to frames."""

    def __init__(self) -> None:
        self._held = bytearray()

    def feed(self, data: bytes) -> list[Frame | Misread]:
        """The frames that are whole by now, and what is none."""
        self._held += data
        found: list[Frame | Misread] = []
        noise = bytearray()
        while size := self._size():
            if size < 0:
                noise.append(self._held.pop(0))
                continue
            if noise:
                found.append(_noise(noise))
                noise.clear()
            found.append(_frame(bytes(self._held[:size])))
            del self._held[:size]
        if noise:
            found.append(_noise(noise))
        return found

    def rest(self) -> bytes:
        """What has come of the next frame."""
        return bytes(self._held)

    def _size(self) -> int:
        """The size of the frame that is held, 0 while it may become one, -1 where none starts."""
        held = self._held
        size = _GROUP
        for at in range(0, len(held) - _GROUP + 1, _GROUP):
            if check(held[at], held[at + 1]) != held[at + 2]:
                return -1
            if at == 0:
                if not held[1] & 1:
                    return -1
                size += _GROUP * (held[1] >> 1 & 3)
            if at + _GROUP == size:
                return size
        return 0


def _frame(data: bytes) -> Frame:
    groups = range(_GROUP, len(data), _GROUP)
    body = b"".join(data[at : at + 2] for at in groups)
    return Frame(_inverted(data[0]), data[1] >> 4, body)


def _noise(data: bytes | bytearray) -> Misread:
    return Misread("groups of two bytes and their check", shown(bytes(data)))


def _fault(number: int) -> Value:
    return Value(None, FAULTS.get(number, f"fault {number}"))


def _group(first: int, second: int) -> bytes:
    return bytes((first, second, check(first, second)))


def _inverted(byte: int) -> int:
    return ~byte & 0xFF


def _upright(body: bytes) -> bytes:
    """The first byte of each group is sent inverted; its own inverse."""
    return bytes(_inverted(byte) if at % 2 == 0 else byte for at, byte in enumerate(body))
