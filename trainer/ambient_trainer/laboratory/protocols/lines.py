"""Text protocols end a reply with one character; foreign bytes before a reply are told, not taken for a part of it."""

from __future__ import annotations

import re

from ambient_trainer.laboratory.protocols.misread import Misread, shown

_FOREIGN = re.compile(rb"[^\x20-\x7e]")


class LineSplitter:
    """Cuts what comes in at ``ending``; ``ignored`` are bytes that may stand at either end of a line."""

    def __init__(self, ending: bytes, ignored: bytes, longest: int) -> None:
        self._ending = ending
        self._ignored = ignored
        self._longest = longest
        self._held = bytearray()

    def feed(self, data: bytes) -> list[str | Misread]:
        """The whole lines in what has come so far, without their ends, and what is none."""
        self._held += data
        *whole, rest = bytes(self._held).split(self._ending)
        found: list[str | Misread] = []
        for line in whole:
            found += self._read(line)
        if len(rest) > self._longest:
            found.append(self._misread(rest))
            rest = b""
        self._held = bytearray(rest)
        return found

    def rest(self) -> bytes:
        """What has come of a line that has not ended."""
        return bytes(self._held)

    def _read(self, line: bytes) -> list[str | Misread]:
        line = line.strip(self._ignored)
        foreign = list(_FOREIGN.finditer(line))
        if not foreign and len(line) <= self._longest:
            return [line.decode("ascii")]
        behind = line[foreign[-1].end() :] if foreign else b""
        found: list[str | Misread] = [self._misread(line[: len(line) - len(behind)])]
        if behind and len(behind) <= self._longest:
            found.append(behind.decode("ascii"))
        return found

    def _misread(self, data: bytes) -> Misread:
        return Misread(f"at most {self._longest} characters of text and {shown(self._ending)}", shown(data))
