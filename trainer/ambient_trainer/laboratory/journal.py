"""A run's journal, ``TRACE.csv.part``: a line a message, on the disk within seconds, so that no end of a run loses it.

The first line says what run it is; every other is a JSON list whose first entry is its kind. A line that a power loss
cut is not there. Times are the run's own, which go on over a stop: the machine's calendar tells how long it lasted.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
from collections.abc import Iterator
from typing import Any, NamedTuple

from ambient_model.faults import Refused, refuse
from ambient_trainer.laboratory.messages import Crash, Doing, Message, Sample, Trouble

FORMAT, VERSION = "ambient-journal", 1
SYNC_S = 1.0
"""The machine's seconds between two flushes to the disk."""


class Head(NamedTuple):
    """What run it is."""

    campaign: str
    sha256: str
    began_unix_s: float
    """The machine's calendar when the run's time was 0."""
    speed: float
    """How fast the run's time goes; 1 but for a simulation."""
    simulated: bool


class Began(NamedTuple):
    """The program is in a step from now on, ``elapsed_s`` into it."""

    at_s: float
    step: int
    elapsed_s: float


class Note(NamedTuple):
    """Something to be told at the end."""

    at_s: float
    text: str


class Identity(NamedTuple):
    """What an instrument says that it is."""

    source: str
    text: str


class End(NamedTuple):
    """The program was left at ``at_s``; what comes after it saw to safety, or is a resumption."""

    at_s: float
    why: str


Entry = Message | Began | Note | Identity | End
_KINDS: dict[str, type[Any]] = {
    "sample": Sample,
    "trouble": Trouble,
    "doing": Doing,
    "began": Began,
    "note": Note,
    "identity": Identity,
    "end": End,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}


class Record(NamedTuple):
    """What a journal holds."""

    head: Head
    entries: tuple[Entry, ...]

    @property
    def last_s(self) -> float:
        """The time of the newest entry."""
        return max((moment(entry) for entry in self.entries), default=0.0)

    @property
    def left(self) -> Began:
        """Where the program was left, and when."""
        newest, until_s = Began(0.0, 0, 0.0), self.last_s
        for entry in self.entries:
            if isinstance(entry, Began):
                newest, until_s = entry, self.last_s
            elif isinstance(entry, End):
                until_s = entry.at_s
        return Began(until_s, newest.step, newest.elapsed_s + max(until_s - newest.at_s, 0.0))


def moment(entry: Entry) -> float:
    """When the entry was made; 0 for one that has no time."""
    if isinstance(entry, Sample):
        return entry.answered_s
    return 0.0 if isinstance(entry, (Identity, Crash)) else entry.at_s


class Journal:
    """A journal that is written: ``add`` returns at once, and a thread brings what was added to the disk."""

    def __init__(self, path: str, head: Head | None = None) -> None:
        """A new journal with ``head``, or without one the one at ``path`` to go on with; raises :class:`Refused`."""
        self.path = path
        self.samples_on_disk = 0
        """Of those added here: acknowledged, and never lost from now on."""
        self.failure: OSError | None = None
        self._lock = threading.Lock()
        self._waiting: list[str] = []
        self._samples_waiting = 0
        self._closing = threading.Event()
        self._file = _opened(path, fresh=head is not None)
        if head is not None:
            self._waiting.append(json.dumps({"format": FORMAT, "version": VERSION, **head._asdict()}) + "\n")
            self._flush()
        self._thread = threading.Thread(target=self._live, name="journal", daemon=True)
        self._thread.start()

    def add(self, entry: Entry) -> None:
        """Have ``entry`` written."""
        line = json.dumps([_NAMES[type(entry)], *entry], separators=(",", ":"), allow_nan=False) + "\n"
        with self._lock:
            self._waiting.append(line)
            self._samples_waiting += isinstance(entry, Sample)

    def close(self) -> None:
        """Bring the rest to the disk."""
        self._closing.set()
        self._thread.join()
        self._flush()
        os.close(self._file)

    def _live(self) -> None:
        while not self._closing.wait(SYNC_S) and self.failure is None:
            self._flush()

    def _flush(self) -> None:
        if self.failure is not None:  # what comes after a line that was cut would make it a damaged one
            return
        with self._lock:
            text, count = "".join(self._waiting), self._samples_waiting
            self._waiting.clear()
            self._samples_waiting = 0
        data = text.encode()
        try:
            while data:
                data = data[os.write(self._file, data) :]
            os.fsync(self._file)
            self.samples_on_disk += count
        except OSError as error:
            self.failure = error


def _opened(path: str, fresh: bool) -> int:
    flags = os.O_WRONLY | os.O_APPEND | (os.O_CREAT | os.O_EXCL if fresh else 0)
    try:
        file = os.open(path, flags, 0o644)
    except FileExistsError as error:
        mend = "go on with it: --resume; or remove it, and with it the samples that it holds"
        raise refuse(path, "", "a run has begun here and not come to its end", mend) from error
    except OSError as error:
        raise refuse(path, "", f"cannot be written ({error.strerror})", "name another output") from error
    if not fresh:
        os.truncate(path, _whole(path))
    _keep_name(path)
    return file


def _keep_name(path: str) -> None:
    """Bring the file's name to the disk, too."""
    folder = os.open(os.path.dirname(path) or ".", os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _whole(path: str) -> int:
    """The length of the file up to its last whole line."""
    with open(path, "rb") as stream:
        return stream.read().rfind(b"\n") + 1


def read_journal(path: str) -> Record:
    """What the journal at ``path`` holds; raises :class:`Refused`, naming the line, for what is none."""
    try:
        with open(path, encoding="utf-8") as stream:
            lines = stream.read().split("\n")[:-1]  # what follows the last newline was cut
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "is there a run to resume?") from error
    except UnicodeDecodeError as error:
        raise refuse(path, "", "is not UTF-8 text", "it is damaged: copy it again") from error
    if not lines:
        raise refuse(path, "", "holds no run", "remove it, and begin anew")
    return Record(_head(path, lines[0]), tuple(_entries(path, lines)))


def _head(path: str, line: str) -> Head:
    with contextlib.suppress(ValueError, TypeError, AttributeError, KeyError):
        data = json.loads(line)
        if (data.pop("format"), data.pop("version")) == (FORMAT, VERSION):
            return Head(**data)
    raise refuse(path, "line 1", "not the head of a journal", "is this another program's file? name another output")


def _entries(path: str, lines: list[str]) -> Iterator[Entry]:
    for number, line in enumerate(lines[1:], 2):
        try:
            kind, *values = json.loads(line)
            entry = _KINDS[kind](*values)
        except (ValueError, TypeError, KeyError):
            raise _damaged(path, number) from None
        if isinstance(entry, Doing) and entry.actions is not None:
            entry = entry._replace(actions=tuple(entry.actions))
        yield entry


def _damaged(path: str, number: int) -> Refused:
    return refuse(path, f"line {number}", "not an entry of a journal", "it is damaged: remove the line, then --resume")
