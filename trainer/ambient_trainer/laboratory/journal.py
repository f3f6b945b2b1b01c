"""A run's journal, ``TRACE.csv.part``: a line an entry, on the disk within seconds, so that no end of a run loses it.

The first line identifies the run; every other is a JSON list whose first entry is its kind. A line that a power loss
cut is left out. Times are the run's own, which go on over a stop: the machine's uptime gives how long it lasted, or,
after a new start, its calendar.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import os
import threading
import time
from pathlib import Path
from typing import NamedTuple, TypeVar

from ambient_model.atomic import flush_to_disk
from ambient_model.faults import refuse
from ambient_trainer.laboratory import messages
from ambient_trainer.laboratory.messages import ENTRIES, End, Entry, Failure, Sample, StepBegan, in_background

FORMAT, VERSION = "ambient-journal", 1
SYNC_S = 1.0
"""The machine's seconds between two flushes of the file to the disk; to the file, all is written at once."""
_Entry = TypeVar("_Entry", bound=Entry)
_NAMES = {kind: name for name, kind in ENTRIES.items()}


class Head(NamedTuple):
    """What run it is.

    ``began_unix_s`` is the machine's calendar when the run's time was 0; ``began_boot_s``, the time since the start
    ``boot`` of the machine, which nobody steps; ``speed`` is 1 except in a simulation.
    """

    campaign: str
    sha256: str
    began_unix_s: float
    speed: float
    simulated: bool
    boot: str = ""
    began_boot_s: float = 0.0

    @classmethod
    def now(cls, campaign: str, sha256: str, speed: float, simulated: bool) -> Head:
        """That of a run whose time is 0 now."""
        return cls(campaign, sha256, time.time(), speed, simulated, *_uptime())

    def now_s(self) -> float:
        """The run's time now; by the calendar where the machine was started anew since it began."""
        boot, uptime_s = _uptime()
        same = boot and boot == self.boot
        return self.speed * (uptime_s - self.began_boot_s if same else time.time() - self.began_unix_s)


def _uptime() -> tuple[str, float]:
    """Which start of the machine this is, and the time since, suspension included; "" where nobody says it."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip(), time.clock_gettime(time.CLOCK_BOOTTIME)
    except (OSError, AttributeError):
        return "", 0.0


class JournalRecord(NamedTuple):
    """What a journal holds."""

    head: Head
    entries: tuple[Entry, ...]

    def of(self, kind: type[_Entry]) -> list[_Entry]:
        """All entries of a kind; a step that was resumed began again."""
        return [entry for entry in self.entries if isinstance(entry, kind)]

    @property
    def deviations(self) -> list[str]:
        """What the chamber did not do of all that the program asks for."""
        sources = (messages.CHAMBER_SET_POINT, messages.CHAMBER_GRADIENT)
        return [each.text for each in self.of(Failure) if each.source in sources]

    @property
    def last_s(self) -> float:
        """The time of the newest entry."""
        times_s = (getattr(entry, "answered_s", getattr(entry, "at_s", 0.0)) for entry in self.entries)
        return max(times_s, default=0.0)

    @property
    def left(self) -> StepBegan:
        """Where the program was left, and when."""
        newest, until_s = StepBegan(0.0, 0, 0.0), self.last_s
        for entry in self.entries:
            if isinstance(entry, StepBegan):
                newest, until_s = entry, self.last_s
            elif isinstance(entry, End):
                until_s = entry.at_s
        return StepBegan(until_s, newest.step, newest.elapsed_s + max(until_s - newest.at_s, 0.0))


class Journal:
    """A journal that is written: ``add`` returns at once, and a thread brings what was added to the disk."""

    def __init__(self, path: str, head: Head | None = None) -> None:
        """A new journal with ``head``, or without one the one at ``path`` to go on with; raises :class:`Refused`."""
        self.path = path
        self.failure: OSError | None = None
        self.samples_on_disk = self._samples_added = 0
        """Of those added here: acknowledged, and never lost from now on."""
        self._lock, self._added = threading.Lock(), threading.Event()
        self._waiting: list[str] = []
        self._closing, self._synced_s = False, -math.inf
        self._file = _opened(path, new=head is not None)
        if head is not None:
            self._waiting.append(json.dumps({"format": FORMAT, "version": VERSION, **head._asdict()}) + "\n")
            self.flush()
        self._thread = in_background(self._run)

    def add(self, entry: Entry) -> None:
        """Have ``entry`` written."""
        line = json.dumps([_NAMES[type(entry)], *entry], separators=(",", ":"), allow_nan=False) + "\n"
        with self._lock:
            self._waiting.append(line)
            self._samples_added += isinstance(entry, Sample)
        self._added.set()

    def close(self) -> None:
        """Bring the rest to the disk."""
        self._closing = True
        self._added.set()
        self._thread.result()
        self.flush()
        os.close(self._file)

    def flush(self, least_s: float = 0.0) -> None:
        """Write what was added so far, and bring it to the disk where the last time was ``least_s`` ago."""
        if self.failure is not None:  # what comes after a line that was cut would make it a damaged one
            return
        with self._lock:
            data = "".join(self._waiting).encode()
            self._waiting.clear()
            count = self._samples_added
        try:
            while data:
                data = data[os.write(self._file, data) :]
            if time.monotonic() - self._synced_s >= least_s:
                os.fsync(self._file)
                self._synced_s, self.samples_on_disk = time.monotonic(), count
        except OSError as error:
            self.failure = error

    def _run(self) -> None:
        while not self._closing and self.failure is None:
            self._added.wait(SYNC_S)
            self._added.clear()
            self.flush(SYNC_S)


def _opened(path: str, new: bool) -> int:
    """The file, cut to its last whole line; its name is brought to the disk, too."""
    flags = os.O_RDWR | os.O_APPEND | (os.O_CREAT | os.O_EXCL if new else 0)
    try:
        file = os.open(path, flags, 0o644)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise refuse(path, "", "belongs to a run that is not over", "let it end, or stop it and wait for it") from error
    except FileExistsError as error:
        hint = "go on with it: --resume; or remove it, and with it the samples that it holds"
        raise refuse(path, "", "a run has begun here and not come to its end", hint) from error
    except OSError as error:
        raise refuse(path, "", f"cannot be written ({error.strerror})", "name another output") from error
    with open(path, "rb") as stream:
        os.truncate(file, stream.read().rfind(b"\n") + 1)
    flush_to_disk(os.path.dirname(path) or ".")
    return file


def read_journal(path: str) -> JournalRecord:
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
    head, entries = _head(path, lines[0]), list[Entry]()
    for number, line in enumerate(lines[1:], 2):
        try:
            kind, *values = json.loads(line)
            entries.append(ENTRIES[kind](*(tuple(value) if isinstance(value, list) else value for value in values)))
        except (ValueError, TypeError, KeyError):
            hint = "it is damaged: remove the line, then --resume"
            raise refuse(path, f"line {number}", "not an entry of a journal", hint) from None
    return JournalRecord(head, tuple(entries))


def _head(path: str, line: str) -> Head:
    with contextlib.suppress(ValueError, TypeError, AttributeError, KeyError):
        data = json.loads(line)
        if (data.pop("format"), data.pop("version")) == (FORMAT, VERSION):
            return Head(**data)
    raise refuse(path, "line 1", "not the head of a journal", "is this another program's file? name another output")
