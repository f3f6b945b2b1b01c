"""What came in and is no reply is a value that says so, never an exception inside a decoder, never a guess."""

from __future__ import annotations

from typing import NamedTuple


class Misread(NamedTuple):
    """Bytes that are no reply of the protocol."""

    expected: str
    """What the protocol would have had there."""
    got: str
    """What was there, as somebody can read it."""


def shown(data: bytes) -> str:
    """Bytes for a message: text where they are text, else in hexadecimal; the middle left out of many."""
    if len(data) > _MOST:
        return f"{shown(data[: _MOST // 2])} ... {shown(data[-_MOST // 2 :])} ({len(data)} bytes)"
    if all(0x20 <= byte < 0x7F or byte in b"\r\n" for byte in data):
        return repr(data.decode("ascii"))
    return data.hex(" ").upper()


_MOST = 48
