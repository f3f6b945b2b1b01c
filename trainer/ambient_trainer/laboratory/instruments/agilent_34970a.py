"""An Agilent or Keysight multiplexer: 34970A, 34972A, DAQ970A. Its protocol is SCPI: ``+2.61950000E+01`` and commas.

Replies end in CR LF. An open thermocouple reads +-9.9E+37. The instrument scans in the order of the channels' numbers,
whatever the order in the list. A bad command gets no reply; ``SYST:ERR?`` gives the reason. In a scan every reading
stands beside its channel's number, so none is taken for another's; after every scan the error is asked for, so that an
answer which belongs to an earlier question is noticed.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
from pydantic import Field, model_validator

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.data.strict_yaml import Strict
from ambient_trainer.laboratory.instruments import Air, MultiplexerSettings, Name, probe_values
from ambient_trainer.laboratory.messages import Clock, InstrumentError, NoResponse, Reading
from ambient_trainer.laboratory.pseudo_terminal import XOFF, XON, Response, SimulatedInstrument
from ambient_trainer.laboratory.serial_line import Answer, Malformed, Query, SerialDriver, SerialLine, text_replies
from ambient_trainer.simulator.chamber import Probes
from ambient_trainer.simulator.live import Probe

OPEN = 9.9e37
"""What is at least as large, of either sign, is an open thermocouple."""
MODELS = ("34970A", "34972A", "DAQ970A")
"""They take the same commands (34970A/34972A Command Reference; DAQ970A Programming Guide)."""

_PROBES = Probes()
_LONGEST = 8192  # 120 channels of 16 characters, with the numbers of the channels
_NUMBER = r"[+-]\d\.\d{8}E[+-]\d\d"
_SCAN = re.compile(rf"{_NUMBER}(?:,{_NUMBER})*|{_NUMBER},[1-3]\d\d(?:,{_NUMBER},[1-3]\d\d)*")
_ERROR = re.compile(r'([+-]\d+),"([^"]*)"')
_IDENTITY = re.compile(r"[^,]*[A-Za-z][^,]*,[^,]+,[^,]+,[^,]+")
Thermocouple = Literal["B", "E", "J", "K", "N", "R", "S", "T"]
_SENSORS = {"thermistor-2k": "THER,2252", "thermistor-5k": "THER,5000", "thermistor-10k": "THER,10000"}
for _name, _coefficient in (("Pt100", 85), ("Pt1000", 85), ("JPt100", 91)):  # 0.00385 of IEC 60751, 0.00391 of old JIS
    _SENSORS |= {_name: f"RTD,{_coefficient}", f"{_name}-4w": f"FRTD,{_coefficient}"}
_SENSORS |= {_letter: f"TC,{_letter}" for _letter in get_args(Thermocouple)}
"""What ``CONF:TEMP`` calls them; a letter is a thermocouple of that type."""
_OTHER_WIRES = 10  # above the channel, in a 34901A


class Channel(Strict):
    """A probe's channel, its slot (1 to 3) and two digits, and its sensor where it is no plain thermocouple."""

    channel: int
    sensor: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _as_channel(cls, data: Any) -> Any:
        return {"channel": data} if isinstance(data, int) else data

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if self.sensor is not None and self.sensor not in _SENSORS:
            yield f"no sensor is called {self.sensor!r}", f"known are {', '.join(_SENSORS)}"
        if not (100 < self.channel < 400 and self.channel % 100):
            yield f"channel {self.channel}", "a channel is its slot, 1 to 3, and two digits, as 101"


class Settings(MultiplexerSettings):
    """The multiplexer: its speed on a serial line, and its thermocouples' type; a probe may have another sensor.

    A sensor is a thermocouple's type, or a resistance thermometer or a thermistor on two wires, or on four (``-4w``).
    """

    kind: Literal["agilent-34970a"]
    probes: Annotated[dict[Name, Channel], Field(min_length=1)]
    baud: Annotated[int, Field(ge=1200)] = 57600
    thermocouple: Thermocouple = "K"

    def _wrong(self) -> Iterator[tuple[str, str]]:
        for channel, sensor in self.sensors.items():
            if sensor.endswith("-4w") and channel + _OTHER_WIRES in self.sensors:
                problem = f"channel {channel + _OTHER_WIRES} holds two of the wires of channel {channel}"
                yield problem, "move its probe to another channel"

    @property
    def sensors(self) -> dict[int, str]:
        """The sensor of each channel."""
        return {each.channel: each.sensor or self.thermocouple for each in self.probes.values()}


class Identity(NamedTuple):
    """The reply to ``*IDN?``."""

    maker: str
    model: str
    serial: str
    firmware: str


class Scan(NamedTuple):
    """The reply to ``READ?``: None where a thermocouple is open; the channels, where the instrument names them."""

    readings: tuple[float | None, ...]
    channels: tuple[int, ...] | None


class ErrorText(NamedTuple):
    """The reply to ``SYST:ERR?``; number 0 is no error."""

    number: int
    text: str

    def __str__(self) -> str:
        return f'{self.number:+d},"{self.text}"'


Reply = Identity | Scan | ErrorText
READ_ERROR = Query(b"SYST:ERR?\n", "an error's number and text", lambda reply: isinstance(reply, ErrorText))
READ_IDENTITY = Query(b"*IDN?\n", f"the identity of a {', '.join(MODELS)}", lambda reply: isinstance(reply, Identity))


def configuration(sensors: Mapping[int, str]) -> bytes:
    """The commands of a scan; its list, and the channels behind the readings, come last, as CONF changes both."""
    commands = ["*RST\n*CLS\n"]
    for sensor in dict.fromkeys(sensors.values()):
        channels = channel_list(channel for channel, each in sensors.items() if each == sensor)
        commands.append(f"CONF:TEMP {_SENSORS[sensor]},{channels}\n")
        if sensor.startswith("Pt1000"):  # else 100 ohm, the instrument's own default
            commands.append(f"SENS:TEMP:TRAN:{_SENSORS[sensor].split(',')[0]}:RES 1000,{channels}\n")
    return f"{''.join(commands)}ROUT:SCAN {channel_list(sensors)}\nFORM:READ:CHAN ON\n".encode("ascii")


def channel_list(channels: Iterable[int]) -> str:
    """``(@101,102,105)``: the channels in the instrument's order."""
    return f"(@{','.join(map(str, sorted(channels)))})"


def _parsed(line: str) -> Reply | Malformed:
    fields = line.split(",")
    if match := _ERROR.fullmatch(line):
        return ErrorText(int(match[1]), match[2])
    if _SCAN.fullmatch(line):
        values = [float(field) for field in fields if "." in field]
        readings = tuple(None if abs(value) >= OPEN else value for value in values)
        return Scan(readings, tuple(int(field) for field in fields if "." not in field) or None)
    if _IDENTITY.fullmatch(line):
        return Identity(*[field.strip() for field in fields])
    return Malformed(repr(line))


decode = text_replies(b"\n", b"\r", _LONGEST, _parsed)
"""From the bytes that a multiplexer sends to its replies."""


class Driver(SerialDriver):
    """The multiplexer on its line; ``read`` sets up the scan where the instrument may have none."""

    def __init__(self, settings: Settings, clock: Clock, offsets: Mapping[str, ProbeOffset] | None = None) -> None:
        self._names = dict(sorted((each.channel, probe) for probe, each in settings.probes.items()))
        self._offsets, self._sensors = offsets, settings.sensors
        self.line = SerialLine("multiplexer", settings, clock, decode, READ_ERROR, baud=settings.baud, xonxoff=True)
        channels = tuple(self._names)
        expected = f"{len(channels)} reading{'s' * (len(channels) > 1)}, of {channel_list(channels)}"
        self._read_scan = Query(
            b"READ?\n", expected, lambda reply: isinstance(reply, Scan) and reply.channels == channels
        )
        self._configured = False

    def identify(self) -> str:
        identity = self.line.query(READ_IDENTITY).reply
        if identity.model not in MODELS:
            raise self.line.failed(READ_IDENTITY.expected, f"that of a {identity.maker} {identity.model}")
        return f"{identity.maker} {identity.model}, firmware {identity.firmware}"

    def configure(self) -> None:
        """Reset the instrument and set up the scan."""
        self.identify()
        set_up = READ_ERROR._replace(request=configuration(self._sensors) + READ_ERROR.request)
        self._check_error("the scan to be set up", self.line.query(set_up).reply)
        self._configured = True

    def read(self) -> Reading:
        """One scan, the offsets added; None where a thermocouple is open."""
        if not self._configured:
            self.configure()
        try:
            asked_s, answered_s, scan = self._scan()
            if between := self.ask_between(READ_ERROR):
                self._check_error(self._read_scan.expected, between.reply)
        except InstrumentError:
            self._configured = False  # it may have been switched off in between: that forgets the scan
            raise
        values = probe_values(dict(zip(self._names.values(), scan.readings)), self._offsets)
        return Reading(asked_s, answered_s, values)

    def close(self) -> None:
        super().close()
        self._configured = False

    def _check_error(self, expected: str, error: Any, silence: str = "") -> None:
        if isinstance(error, ErrorText) and error.number:
            hint = "switched off, it forgets its scan: the next reading sets it up again"
            raise self.line.failed(expected, f"{silence}error {error}", hint=hint)

    def _scan(self) -> Answer:
        try:
            return self.line.query(self._read_scan)
        except NoResponse as silent:  # where it did not understand, which it then reports
            self._check_error(self._read_scan.expected, self.line.synchronise(), f"{silent.got}, and ")
            raise


_ANSWERS_AFTER_S, _RESET_S, _CHANNEL_S = 0.01, 0.3, 0.06  # chosen; a relay, and a reading over some mains periods
_MOST_ERRORS = 10


class Simulated(SimulatedInstrument):
    """The multiplexer with thermocouples in ``air``; what each reads too much is drawn, or given by ``errors_K``."""

    _configured: frozenset[int]
    _scanned: list[int]

    def __init__(
        self, settings: Settings, clock: Clock, air: Air, seed: int = 0, errors_K: Mapping[str, float] | None = None
    ) -> None:
        random = np.random.default_rng(seed)
        names = dict(sorted((each.channel, name) for name, each in settings.probes.items()))
        drawn_K = _PROBES.calibration_degC * random.standard_normal(len(names))
        self.errors_K = dict(errors_K or zip(names.values(), drawn_K.tolist()))
        self.probes = {channel: Probe(air, self.errors_K[name], random) for channel, name in names.items()}
        self._errors: deque[ErrorText] = deque(maxlen=_MOST_ERRORS)
        self._reset()
        super().__init__("multiplexer", clock, settings.baud)

    def _respond(self, data: bytes) -> Iterator[Response]:
        for line in self._lines(data, b"\n"):
            for command in line.upper().split(";"):
                yield from self._execute(command.strip())

    def _execute(self, command: str) -> Iterator[Response]:
        head, _, argument = command.partition(" ")
        match head:
            case "*IDN?":
                yield Response(_ANSWERS_AFTER_S, b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n")
            case "*RST":
                yield Response(0.0, XOFF)  # its buffer is small, and it does not listen meanwhile
                self._reset()
                yield Response(_RESET_S, XON)
            case "*CLS":
                self._errors.clear()
            case "SYST:ERR?":
                error = self._errors.popleft() if self._errors else ErrorText(0, "No error")
                yield Response(_ANSWERS_AFTER_S, f"{error}\r\n".encode("ascii"))
            case "CONF:TEMP":
                self._scanned = self._channels(argument[argument.index("(") :])
                self._configured |= {*self._scanned}
                self._with_channels = False
            case "ROUT:SCAN":
                self._scanned = self._channels(argument)
            case "FORM:READ:CHAN" if argument in ("ON", "OFF"):
                self._with_channels = argument == "ON"
            case "READ?":
                yield from self._scan()
            case "" | "SENS:TEMP:TRAN:RTD:RES" | "SENS:TEMP:TRAN:FRTD:RES":
                pass  # a channel reads its probe, whatever that is
            case _:
                self._errors.append(ErrorText(-113, "Undefined header"))

    def _scan(self) -> Iterator[Response]:
        if not self._scanned or not set(self._scanned) <= self._configured:
            self._errors.append(ErrorText(-221, "Settings conflict"))
            return
        due_s = self._clock.now_s() + _CHANNEL_S * np.arange(1, len(self._scanned) + 1)
        texts = []
        for channel, at_s in zip(self._scanned, due_s.tolist()):
            value = self.probes[channel].read(at_s)
            texts.append(f"{OPEN if value is None else value:+.8E}" + f",{channel}" * self._with_channels)
        yield Response(len(texts) * _CHANNEL_S, f"{','.join(texts)}\r\n".encode("ascii"))

    def _channels(self, text: str) -> list[int]:
        """The channels of a list such as ``(@101,103)``, in the instrument's order."""
        found = {int(part) if part.isdigit() else 0 for part in text.strip().removeprefix("(@").rstrip(")").split(",")}
        if not found <= self.probes.keys():
            self._errors.append(ErrorText(-224, "Illegal parameter value"))
            return []
        return sorted(found)

    def _reset(self) -> None:
        self._configured, self._scanned, self._with_channels = frozenset(), [], False
