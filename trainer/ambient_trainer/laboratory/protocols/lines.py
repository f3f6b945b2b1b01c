"""Text protocols end a reply with one character; foreign bytes before a reply are told, not taken for a part of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Generic, TypeVar

from ambient_trainer.laboratory.protocols.misread import Misread, shown

_FOREIGN = re.compile(rb"[^\x20-\x7e]")


_Reply = TypeVar("_Reply")


class LineDecoder(Generic[_Reply]):
    """Cuts what comes in at ``ending`` and has ``reply`` read each line.

    ``ignored`` are bytes that may stand at either end of a line.
    """

    def __init__(self, ending: bytes, ignored: bytes, longest: int, reply: Callable[[str], _Reply | Misread]) -> None:
        self._ending = ending
        self._ignored = ignored
        self._longest = longest
        self._reply = reply
        self._held = bytearray()

    def feed(self, data: bytes) -> list[_Reply | Misread]:
        """The replies that are whole by now, and what is none."""
        self._held += data
        *whole, rest = bytes(self._held).split(self._ending)
        found: list[_Reply | Misread] = []
        for line in whole:
            found += self._read(line)
        if len(rest) > self._longest:
            found.append(self._misread(rest))
            rest = b""
        self._held = bytearray(rest)
        return found

    def rest(self) -> bytes:
        """What has come of the next reply."""
        return bytes(self._held)

    def _read(self, line: bytes) -> list[_Reply | Misread]:
        line = line.strip(self._ignored)
        foreign = list(_FOREIGN.finditer(line))
        if not foreign and len(line) <= self._longest:
            return [self._reply(line.decode("ascii"))]
        behind = line[foreign[-1].end() :] if foreign else b""
        found: list[_Reply | Misread] = [self._misread(line[: len(line) - len(behind)])]
        if behind and len(behind) <= self._longest:
            found.append(self._reply(behind.decode("ascii")))
        return found

    def _misread(self, data: bytes) -> Misread:
        return Misread(f"at most {self._longest} characters of text and {shown(self._ending)}", shown(data))
