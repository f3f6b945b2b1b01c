"""Untrusted files and values are read and quoted in bounded time and memory."""

import os
import stat
from collections.abc import Iterable
from typing import Any

from ambient_model.faults import refuse

_LONGEST_SHOWN = 60


def read_whole(path: str, most_bytes: int) -> bytes:
    """The content of the regular file at ``path``, cut one byte beyond ``most_bytes``.

    Raises :class:`~ambient_model.faults.Refused` where it cannot be read, and for a pipe or a device, which might
    never end.
    """
    try:
        with open(path, "rb", opener=_without_waiting) as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise refuse(path, "", "is no regular file", "name a file, and not a pipe or a device")
            return stream.read(most_bytes + 1)
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "check the name and the permissions") from error


def _without_waiting(path: str, flags: int) -> int:
    """Otherwise the opening of a pipe waits for its writer."""
    return os.open(path, flags | os.O_NONBLOCK)


def first_double(names: Iterable[Any]) -> Any | None:
    """The first of ``names`` that has stood there before, None where each stands once."""
    seen = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def shown(value: Any) -> str:
    """``value`` as a message shows it: as Python writes it, cut short."""
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."
