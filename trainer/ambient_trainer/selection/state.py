"""What is done is kept line by line, for the traces and options it was done with: a search goes on where it stopped.

The first line of a state file says what it belongs to; each further one holds results by their key. A line that a
killed search left half-written is cut off.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from typing import IO, Any

from ambient_model.atomic import replacing
from ambient_model.faults import Fault, Refused, refuse

_FORMAT, _VERSION = "ambient-search-state", 1
_ANEW = "remove it to start anew, or name another --state"


class State:
    """Results by key: in memory and, where there is a file, on the disk as soon as they are known."""

    def __init__(self, path: str | None, identity: Mapping[str, Any]) -> None:
        """Opens or makes the file; raises :class:`Refused` for one that belongs to something else."""
        self.path = path
        self.results: dict[str, Any] = {}
        self._stream: IO[str] | None = None
        if path is None:
            return
        if not os.path.exists(path):
            with replacing(path) as stream:
                stream.write(json.dumps({"format": _FORMAT, "version": _VERSION, **identity}) + "\n")
        self._stream = _locked(path)
        try:
            self.results = _read(self._stream, path, identity)
        except BaseException:
            self._stream.close()
            raise

    def close(self) -> None:
        """Let go of the file."""
        if self._stream is not None:
            self._stream.close()

    def add(self, found: Mapping[str, Any]) -> None:
        """Keep these results."""
        self.results.update(found)
        if self._stream is not None:
            self._stream.write(json.dumps(found) + "\n")
            self._stream.flush()


def _locked(path: str) -> IO[str]:
    # it stays open, and so locked, as long as the search runs
    stream = open(path, "r+", encoding="utf-8")  # noqa: SIM115
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        raise refuse(path, "", "another search is writing it", "wait for it, or name another --state") from None
    return stream


def _read(stream: IO[str], path: str, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Its results; the stream then stands behind the last whole line."""
    try:
        text = stream.read()
    except UnicodeDecodeError:
        raise refuse(path, "", "is not the state of a search", "name another --state") from None
    whole = text[: text.rfind("\n") + 1]
    lines = whole.splitlines()
    _belongs(_object(lines[0], path, 1) if lines else {}, path, identity)
    results: dict[str, Any] = {}
    for number, line in enumerate(lines[1:], start=2):
        results.update(_object(line, path, number))
    stream.seek(len(whole.encode()))
    stream.truncate()
    return results


def _object(line: str, path: str, number: int) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError:
        found = None
    if isinstance(found, dict):
        return found
    problem = "is not the state of a search" if number == 1 else "is damaged"
    raise refuse(path, f"line {number}", problem, "name another --state" if number == 1 else _ANEW)


def _belongs(header: Mapping[str, Any], path: str, identity: Mapping[str, Any]) -> None:
    if header.get("format") != _FORMAT:
        raise refuse(path, "line 1", "is not the state of a search", "name another --state")
    faults = [
        Fault(name, f"the state was made with {header.get(name)!r:.200}, this search has {value!r:.200}", _ANEW)
        for name, value in {"version": _VERSION, **json.loads(json.dumps(identity))}.items()
        if header.get(name) != value
    ]
    if faults:
        raise Refused(path, faults)
