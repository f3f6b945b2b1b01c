"""SCPI as a 34970A multiplexer speaks it: readings ``+2.61950000E+01`` between commas, replies end in CR LF.

An open thermocouple reads +-9.9E+37. The instrument scans in the order of the channels' numbers, whatever the order
in the list. A bad command gets no reply; ``SYST:ERR?`` says why.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from ambient_trainer.laboratory.protocols.lines import LineDecoder
from ambient_trainer.laboratory.protocols.misread import Misread

IDENTITY = b"*IDN?\n"
RESET = b"*RST\n*CLS\n"
READ = b"READ?\n"
ERROR = b"SYST:ERR?\n"
OPEN = 9.9e37
"""What is at least as large, of either sign, is an open thermocouple."""
CHANNELS_WITH_READINGS = b"FORM:READ:CHAN ON\n"
"""Puts each reading's channel behind it; CONF switches it off again."""

_LONGEST = 8192  # 120 channels of 16 characters, with the numbers of the channels
_NUMBER = re.compile(r"[+-]\d\.\d{8}E[+-]\d\d")
_CHANNEL = re.compile(r"[1-3]\d\d")
_ERROR = re.compile(r'([+-]\d+),"([^"]*)"')
_IDENTITY = re.compile(r"[^,]*[A-Za-z][^,]*,[^,]+,[^,]+,[^,]+")
_A_REPLY = "readings, an error's number and text, or an identity"


class Identity(NamedTuple):
    """The reply to :data:`IDENTITY`."""

    maker: str
    model: str
    serial: str
    firmware: str


class Scan(NamedTuple):
    """The reply to :data:`READ`."""

    readings: tuple[float | None, ...]
    """None where a thermocouple is open."""
    channels: tuple[int, ...] | None
    """Each reading's channel, where the instrument says it."""


class ErrorText(NamedTuple):
    """The reply to :data:`ERROR`; number 0 is no error."""

    number: int
    text: str

    def __str__(self) -> str:
        return f'{self.number:+d},"{self.text}"'


Reply = Identity | Scan | ErrorText


def configure(channels: Iterable[int], thermocouple: str) -> bytes:
    """The commands that make a scan of thermocouples of type ``thermocouple``, such as ``K``, on ``channels``."""
    listed = channel_list(channels)
    return b"CONF:TEMP TC,%s,%s\nROUT:SCAN %s\n" % (thermocouple.encode("ascii"), listed, listed)


def channel_list(channels: Iterable[int]) -> bytes:
    """``(@101:103,105)``: the channels in the instrument's order, runs of them as ranges."""
    runs: list[list[int]] = []
    for channel in sorted(set(channels)):
        if runs and channel == runs[-1][-1] + 1:
            runs[-1].append(channel)
        else:
            runs.append([channel])
    texts = [f"{run[0]}:{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs]
    return f"(@{','.join(texts)})".encode("ascii")


def scan_line(scan: Scan) -> bytes:
    """The reply that says ``scan``."""
    texts = [f"{OPEN if value is None else value:+.8E}" for value in scan.readings]
    if scan.channels is not None:
        texts = [f"{text},{channel}" for text, channel in zip(texts, scan.channels)]
    return ",".join(texts).encode("ascii") + b"\r\n"


class Decoder(LineDecoder[Reply]):
    """What a multiplexer sends, in pieces of any size, to replies."""

    def __init__(self) -> None:
        super().__init__(b"\n", b"\r", _LONGEST, _reply)


def _reply(line: str) -> Reply | Misread:
    if match := _ERROR.fullmatch(line):
        return ErrorText(int(match[1]), match[2])
    fields = line.split(",")
    if all(_NUMBER.fullmatch(field) for field in fields):
        return Scan(tuple(_reading(field) for field in fields), None)
    values, channels = fields[::2], fields[1::2]
    if (
        len(values) == len(channels)
        and all(_NUMBER.fullmatch(value) for value in values)
        and all(_CHANNEL.fullmatch(channel) for channel in channels)
    ):
        return Scan(tuple(_reading(value) for value in values), tuple(int(channel) for channel in channels))
    if _IDENTITY.fullmatch(line):
        return Identity(*[field.strip() for field in fields])
    return Misread(_A_REPLY, repr(line))


def _reading(text: str) -> float | None:
    value = float(text)
    return None if abs(value) >= OPEN else value
