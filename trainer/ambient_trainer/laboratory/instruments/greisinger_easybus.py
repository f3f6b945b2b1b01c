"""A Greisinger GMH thermometer. Its protocol is EASYBus: groups of two bytes and a check, the first byte inverted.

A request is ``[~address, code << 4, check]``. A reply's first group is ``[~address, code << 4 | flags, check]``: bit 0
of the flags marks a reply, bits 1 and 2 count the groups that follow, bit 3 is set by a fault. Nothing ends a frame, so
the decoder looks for groups whose check is right, and moves on by one byte where one is not. The 32 bits of a value of
two groups, their first bytes inverted back: five bits of decimals plus 15, then 27 of digits less 2^25 (modulo 2^27),
or of a fault's number above 0x07F5E100. Of one group: two bits of decimals, 14 of digits plus 2048, faults from 0x3FE0.
(Schnittstellenbeschreibung fuer EASYBus-Sensormodule und GMH-Handmessgeraete, sections 8.1 and 8.5.)
What has a number above 15 is asked for by code 15 and a group of its own, ``[~number, 0, check]``; a reply's last group
has its value. 202 is the unit of the display, in which values come (`display_unit` in rgieseke/pyEasybus).
The instrument switches itself off; without a sensor it reports that instead of a number.
"""

from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from ambient_trainer.data.units import to_base
from ambient_trainer.laboratory.instruments import DIGITS, THERMOMETER_COLUMN, Air, ThermometerSettings
from ambient_trainer.laboratory.messages import Clock, Reading
from ambient_trainer.laboratory.pseudo_terminal import Response, SimulatedInstrument
from ambient_trainer.laboratory.serial_line import Malformed, Query, SerialDriver, SerialLine, shown

VALUE, IDENTITY = 0, 12
"""The codes that ask for the measured value, and for the number that stands on the instrument, in hexadecimal."""
FURTHER, UNIT = 15, 202
NAMES = {1: "degC", 2: "degF", 3: "K"}
"""By the number that the instrument gives: the unit."""
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
_BAUD = 4800
_GROUP = 3
_MOST_DECIMALS = 7  # of the nine digits that 27 bits hold
_FAULTS_32, _FAULTS_16 = 0x07F5E100, 0x3FE0


class Settings(ThermometerSettings):
    """The thermometer, its address on the bus, and the unit of its display, which else is asked for."""

    kind: Literal["greisinger-easybus"]
    address: Annotated[int, Field(ge=0, le=255)] = 1
    unit: Literal["degC", "degF", "K"] | None = None


class Frame(NamedTuple):
    """One reply: whose, to which code, and its bytes without the checks."""

    address: int
    code: int
    body: bytes

    def __str__(self) -> str:
        return f"a reply of address {self.address} to code {self.code} ({self.body.hex(' ').upper()})"


def check(first: int, second: int) -> int:
    """The third byte of a group."""
    rest = (first << 8) | second
    for _ in range(16):
        rest = (rest << 1) ^ 0x700 if rest & 0x8000 else rest << 1
    return ~(rest >> 8) & 0xFF


def request(address: int, code: int) -> bytes:
    """The question for ``code``; from 15 on, it has a group of its own."""
    if code < FURTHER:
        return _groups(address, code << 4)
    return _groups(address, FURTHER << 4 | 1 << 1, bytes((~code & 0xFF, 0)))


def reply(address: int, code: int, body: bytes, faulty: bool = False) -> bytes:
    """The frame of a reply; ``body`` is of an even number of bytes, as on the line but for the checks."""
    return _groups(address, code << 4 | faulty << 3 | len(body) // 2 << 1 | 1, body)


def _groups(address: int, second: int, body: bytes = b"") -> bytes:
    data = bytes((~address & 0xFF, second)) + body
    return b"".join(bytes((*pair, check(*pair))) for pair in zip(data[::2], data[1::2]))


def decode(data: bytes) -> tuple[list[Frame | Malformed], bytes]:
    """From the bytes that a thermometer sends to its frames, to what is none, and to the begin of the next frame."""
    found: list[Frame | Malformed] = []
    noise = b""
    while size := _frame_size(data):
        if size < 0:
            noise, data = noise + data[:1], data[1:]
            continue
        body = b"".join(data[at : at + 2] for at in range(_GROUP, size, _GROUP))
        found += [Malformed(shown(noise))] * bool(noise)
        found.append(Frame(~data[0] & 0xFF, data[1] >> 4, body))
        noise, data = b"", data[size:]
    return [*found, *[Malformed(shown(noise))] * bool(noise)], data


def _frame_size(data: bytes, replies: int = 1) -> int:
    """The size of the frame that begins ``data``, 0 while it may become one, -1 where none begins."""
    size = _GROUP
    for at in range(0, len(data) - _GROUP + 1, _GROUP):
        if check(data[at], data[at + 1]) != data[at + 2] or data[1] & 1 != replies:
            return -1
        size = _GROUP * (1 + (data[1] >> 1 & 3))
        if at + _GROUP == size:
            return size
    return 0


def value_of(body: bytes) -> tuple[float | None, str | None]:
    """The value in a reply to :data:`VALUE`, or why there is none; ``ValueError`` with what was expected, and came."""
    number = number_of(body)
    if len(body) == 4:
        digits, decimals = number & 0x07FFFFFF, (number >> 27) - 15
        if digits >= _FAULTS_32:
            return _fault(digits - _FAULTS_32)
        if not 0 <= decimals <= _MOST_DECIMALS:
            raise ValueError(f"a value of 0 to {_MOST_DECIMALS} decimals", f"{decimals} decimals")
        digits = (digits + 0x02000000) & 0x07FFFFFF
        return (digits - 0x08000000 * (digits >> 26)) / 10.0**decimals, None
    if len(body) == 2:
        digits = number & 0x3FFF
        return _fault(digits) if digits >= _FAULTS_16 else ((digits - 2048) / 10.0 ** (number >> 14), None)
    raise ValueError("a value of one group or two", f"{len(body) // 2} groups")


def _fault(number: int) -> tuple[None, str]:
    return None, FAULTS.get(number, f"fault {number}")


def number_of(body: bytes) -> int:
    """The whole number in the body of a reply."""
    return int.from_bytes(_upright(body), "big")


def body_of_number(number: int) -> bytes:
    """The body of two groups that holds a whole number."""
    return _upright(number.to_bytes(4, "big"))


def _upright(body: bytes) -> bytes:
    """The first byte of each group is sent inverted; its own inverse."""
    return bytes(byte ^ 0xFF if at % 2 == 0 else byte for at, byte in enumerate(body))


class Driver(SerialDriver):
    """The thermometer on its serial line."""

    def __init__(self, settings: Settings, clock: Clock) -> None:
        self._read_value = _query(settings.address, VALUE, "its value")
        self._read_identity = identity = _query(settings.address, IDENTITY, "its number")
        self._read_unit = _query(settings.address, UNIT, "its unit") if settings.unit is None else None
        self._unit: str = settings.unit or "degC"
        hint = "switch it on"
        self.line = SerialLine("thermometer", settings, clock, decode, identity, baud=_BAUD, silent_hint=hint)

    def identify(self) -> str:
        return f"GMH thermometer, number {number_of(self.line.query(self._read_identity).reply.body):x}"

    def read(self) -> Reading:
        asked_s, answered_s, frame = self.line.query(self._read_value)
        between = self.ask_between(self._read_unit or self._read_identity)
        if between and self._read_unit:
            number = number_of(between.reply.body[-2:])
            if number not in NAMES:
                got, hint = f"unit number {number}", "set its display to degC"
                raise self.line.failed("a display in degC, degF or K", got, hint=hint)
            self._unit = NAMES[number]
        try:
            value, reason = value_of(frame.body)
        except ValueError as error:
            raise self.line.failed(*error.args) from error
        temp_degC = None if value is None else round(to_base(value, self._unit), DIGITS)
        return Reading(asked_s, answered_s, {THERMOMETER_COLUMN: temp_degC}, reason)


def _query(address: int, code: int, what: str) -> Query:
    expected, answer = f"{what}, a reply of address {address} to code {code}", (address, min(code, FURTHER))
    return Query(request(address, code), expected, lambda frame: (frame.address, frame.code) == answer)


_ANSWERS_AFTER_S = 0.02  # chosen
_NUMBER = 0x32407008
_DECIMALS = 2
_DEGC = 1  # as in NAMES


class Simulated(SimulatedInstrument):
    """The thermometer in ``air``, which shows degC."""

    def __init__(self, settings: Settings, clock: Clock, air: Air) -> None:
        self._air, self._address = air, settings.address
        super().__init__("thermometer", clock, _BAUD)

    def _respond(self, data: bytes) -> Iterator[Response]:
        self._received += data
        while size := _frame_size(self._received, replies=0):
            asked, self._received = self._received[: max(size, 1)], self._received[max(size, 1) :]
            for code in (VALUE, IDENTITY, UNIT):
                if asked == request(self._address, code):
                    yield Response(_ANSWERS_AFTER_S, reply(self._address, min(code, FURTHER), self._body(code)))

    def _body(self, code: int) -> bytes:
        if code == IDENTITY:
            return body_of_number(_NUMBER)
        if code == UNIT:
            return bytes((~UNIT & 0xFF, 0)) + _upright(_DEGC.to_bytes(2, "big"))
        digits = round(self._air(self._clock.now_s()) * 10**_DECIMALS)
        return body_of_number((_DECIMALS + 15) << 27 | (digits - 0x02000000) & 0x07FFFFFF)
